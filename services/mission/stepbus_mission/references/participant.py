"""The reference mission as a participant: publishes references, and reports when it is done."""

import math
from collections.abc import Mapping
from itertools import chain
from typing import Any

import msgspec

from stepbus_participant import Config, Method, Participant, Ports, Steering, Step, make_plugin
from stepbus_schemas import Description, Event, JointReference, Message, RunError

from .generators import Generator, Sine, SineRow, StepChange
from .params import Params
from .steering import SavedTargets, Targets
from .trajectories import CsvTrajectory, Waypoints

TASKS: dict[str, type[Generator]] = {
    "csv": CsvTrajectory,
    "sine": Sine,
    "step": StepChange,
    "waypoints": Waypoints,
}
"""Value of `task` in the scenario → its class."""


STEERED: Mapping[str, Mapping[str, str]] = {
    "sine": {"amplitude": "rad", "omega": "rad/s", "phase": "rad", "offset": "rad"},
    "step": {"target": "rad", "initial": "rad", "time": "s"},
}
"""Task → its parameters that calls can set, with their units."""


class Saved(msgspec.Struct):
    """The state of a mission at a checkpoint.

    params: with those that calls have set. sine, targets: of `Sine` and `Targets`.
    """

    params: dict[str, Any]
    sine: list[SineRow]
    targets: SavedTargets
    is_done: bool


class Mission(Participant):
    """Publishes a reference at every step.

    Outputs: one JointReference/1 and, if the scenario wires it, one Event/1 that reports the start
    and the end. The scenario names the ports. There are no inputs. Calls send a joint to a position
    and set parameters of the task; another `omega` keeps the angle that the sine has come to.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._reference_port = ports.output_of("JointReference/1")
        self._event_port = ports.optional_output_of("Event/1")
        ports.outputs_are("JointReference/1", "Event/1")
        params = config.read(Params, ports.problems)
        self._joints = [params.prefix + joint for joint in params.joints]
        self._lengths = [len(self._joints)] * 3
        self._end_when_done = params.end_when_done
        self._task = params.task
        self.generator = make_generator(config, params)
        self._changed: Params | None = None
        self._targets = Targets(self._joints)
        self._steering = Steering(config, Params, STEERED.get(params.task, {}), self._change)
        duration = duration_of(self.generator)
        self._done_ns = math.inf if math.isinf(duration) else round(duration * 1e9)
        self._is_done = False

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of the reference."""
        described = {self._reference_port: Description(names=self._joints)}
        if self._event_port is not None:
            described[self._event_port] = Description()
        return described

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the reference of this step."""
        messages: dict[str, Message] = {
            self._reference_port: self._checked(self._reference(step.t), step)
        }
        if step.index == 0:
            self._report(messages, f"{self._task} of {', '.join(self._joints)} starts")
        if step.t_ns >= self._done_ns and not self._is_done:
            self._is_done = True
            text = f"{self._task} is done at {step.t:.3f} s"
            self._report(messages, text)
            if self._end_when_done:
                step.end(f"{self.config.name}: {text}")
        return messages

    def _reference(self, t: float) -> JointReference:
        """Return the reference of a time [s]; calls take effect here."""
        if self._changed is not None:
            params, self._changed = self._changed, None
            if isinstance(self.generator, Sine):
                self.generator = self.generator.changed(params.joints, params, t)
            else:
                self.generator = make_generator(self.config, params)
        return self._targets.apply(t, self.generator.at(t))

    def _change(self, params: Params) -> None:
        make_generator(self.config, params)
        self._changed = params

    def calls(self) -> Mapping[str, Method]:
        """Return the calls that send a joint somewhere, and that set what the task has."""
        return {
            "set_target": Method(
                self._targets.set_target,
                "JOINT POSITION [SECONDS]: sends a joint to a position [rad], or degrees such as "
                "30deg, with minimum jerk over a time "
                "(default: at once); it stays there",
                changes=True,
            ),
            "follow_task": Method(
                self._targets.follow_task,
                "[JOINT]: lets a joint, or all, follow the task again, at once",
                changes=True,
            ),
            **self._steering.methods(),
        }

    def save(self) -> bytes | None:
        """Return what calls have changed; None with a generator of one's own, which has no such."""
        if self._task not in TASKS or self._changed is not None:
            return None
        rows = self.generator.save() if isinstance(self.generator, Sine) else []
        targets = self._targets.save()
        if targets is None:
            return None
        saved = Saved(
            params=self._steering.save(), sine=rows, targets=targets, is_done=self._is_done
        )
        return msgspec.msgpack.encode(saved)

    def restore(self, state: bytes) -> None:
        """Take what `save` returned."""
        saved = msgspec.msgpack.decode(state, type=Saved)
        self.generator = make_generator(self.config, self._steering.restore(saved.params))
        if isinstance(self.generator, Sine):
            self.generator.restore(saved.sine)
        self._targets.restore(saved.targets)
        self._is_done = saved.is_done

    def _report(self, messages: dict[str, Message], text: str) -> None:
        if self._event_port is not None:
            messages[self._event_port] = Event(level="info", text=text)

    def _checked(self, reference: JointReference, step: Step) -> JointReference:
        """Return the reference; raises RunError for a wrong length or value."""
        vectors = (reference.position, reference.velocity, reference.acceleration)
        lengths = [len(vector) for vector in vectors]
        if lengths != self._lengths:
            raise RunError(
                f"{self.config.name}: step {step.index}: {self._task} returned {lengths} values of "
                f"position, velocity, acceleration for {len(self._joints)} joints"
            )
        if not all(map(math.isfinite, chain(*vectors))):
            raise RunError(
                f"{self.config.name}: step {step.index}: {self._task} returned a value that is "
                f"not finite: {reference}"
            )
        return reference


def make_generator(config: Config, params: Params) -> Generator:
    """Return the generator of a task; raises SettingsError for invalid parameters."""
    problems = config.problems().below(("params",))
    generator: Generator | None
    if params.task in TASKS:
        task = TASKS[params.task]
        generator = problems.attempt(("file",), lambda: task(params.joints, params))
    else:
        generator = make_plugin(config, "task", params.task, params.own, "at", params.joints)
    if generator is None:
        raise problems.error()
    if params.end_when_done and math.isinf(duration_of(generator)):
        problems.add(("end_when_done",), "is true, but this task never ends")
    problems.refuse()
    return generator


def duration_of(generator: Generator) -> float:
    """Return when a generator comes to rest for good [s]; infinity: never."""
    return float(getattr(generator, "duration", math.inf))
