"""What calls change of a mission that publishes references, from the next step on."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

import msgspec

from stepbus_mission.generators import Generator, Sine, SineRow, StepChange
from stepbus_mission.params import Params
from stepbus_mission.trajectories import CsvTrajectory, Knot, Waypoints, evaluate, quintic
from stepbus_participant import (
    CallError,
    Config,
    Method,
    Participant,
    Ports,
    Steering,
    Step,
    make_plugin,
    suggest,
)
from stepbus_schemas import Description, Event, JointReference, Message, RunError


def _radians(position: float | str) -> float:
    """Return an angle [rad]; text: degrees."""
    text = position.removesuffix("deg").removesuffix("°") if isinstance(position, str) else ""
    try:
        return math.radians(float(text)) if isinstance(position, str) else position
    except ValueError as exc:
        raise CallError(f"{position!r} is no target: write rad, or degrees such as 30deg") from exc


class SavedTargets(msgspec.Struct):
    """paths: of joints by index, as in `Targets`. last: the newest reference and its time [s]."""

    paths: dict[int, tuple[float, float, Knot, float]]
    last: tuple[float, list[float], list[float], list[float]] | None


class Targets:
    """Positions that joints were sent to, instead of following the task.

    joints: of the reference, in its order.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._pending: list[Callable[[float], None]] = []
        self._paths: dict[int, tuple[float, float, Knot, float]] = {}
        self._last: tuple[float, JointReference] | None = None

    def set_target(self, joint: str, position: float | str, duration_s: float = 0.0) -> None:
        """Send a joint to a position [rad], with minimum jerk over a time [s]; 0: at once.

        position: a number, or degrees such as `30deg`. Raises CallError for an unknown joint, or
        what is no number.
        """
        index = self._index(joint)
        position = _radians(position)
        numbers = (position, duration_s)
        is_number = [isinstance(n, int | float) and not isinstance(n, bool) for n in numbers]
        if not all(is_number) or not all(map(math.isfinite, numbers)) or duration_s < 0:
            raise CallError(f"{joint}: {position!r} rad in {duration_s!r} s is no target")
        target = float(position)
        self._pending.append(lambda t: self._start(index, target, duration_s, t))

    def follow_task(self, joint: str | None = None) -> None:
        """Let a joint follow the task again, or all of them."""
        indices = range(len(self._joints)) if joint is None else [self._index(joint)]
        self._pending.append(lambda _t: self._forget(indices))

    def _forget(self, indices: Iterable[int]) -> None:
        for index in indices:
            self._paths.pop(index, None)

    def _index(self, joint: str) -> int:
        if joint not in self._joints:
            raise CallError(f"joint {joint!r} is unknown{suggest(str(joint), self._joints)}")
        return self._joints.index(joint)

    def _start(self, index: int, position: float, duration_s: float, t: float) -> None:
        if self._last is None or not duration_s:
            self._paths[index] = (t, 0.0, (0.0, 0.0, 0.0), position)
            return
        since, last = self._last
        start = (last.position[index], last.velocity[index], last.acceleration[index])
        self._paths[index] = (since, duration_s, start, position)

    def save(self) -> SavedTargets | None:
        """Return where joints were sent, for a checkpoint; None while a call waits for its step."""
        if self._pending:
            return None
        last = None
        if self._last is not None:
            t, target = self._last
            last = (t, list(target.position), list(target.velocity), list(target.acceleration))
        return SavedTargets(paths=dict(self._paths), last=last)

    def restore(self, saved: SavedTargets) -> None:
        """Take what `save` returned."""
        self._paths = dict(saved.paths)
        if saved.last is not None:
            t, position, velocity, acceleration = saved.last
            reference = JointReference(
                position=position, velocity=velocity, acceleration=acceleration
            )
            self._last = t, reference

    def apply(self, t: float, task: JointReference) -> JointReference:
        """Return the reference of a time [s]; task: that of the task."""
        for change in self._pending:
            change(t)
        self._pending.clear()
        target = task if not self._paths else self._moved(t, task)
        self._last = t, target
        return target

    def _moved(self, t: float, task: JointReference) -> JointReference:
        rows = (list(task.position), list(task.velocity), list(task.acceleration))
        for index, (since, duration_s, start, position) in self._paths.items():
            end = (position, 0.0, 0.0)
            knot = end
            if t - since < duration_s:
                knot = evaluate(quintic(start, end, duration_s), t - since)
            for row, value in zip(rows, knot, strict=True):
                row[index] = value
        return JointReference(position=rows[0], velocity=rows[1], acceleration=rows[2])


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
