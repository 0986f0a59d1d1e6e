"""The mission: publishes the reference of a task, unless a call moved a joint elsewhere."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import msgspec

from stepbus_mission.generators import STEERED, TASKS, Generator, Sine, duration_of
from stepbus_mission.params import Params, SineParams
from stepbus_mission.polynomials import Knot, evaluate, quintic
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
    if not isinstance(position, str):
        return position
    try:
        return math.radians(float(position.removesuffix("deg").removesuffix("°")))
    except ValueError as exc:
        raise CallError(
            f"{position!r} is not a position; write radians, or degrees such as 30deg"
        ) from exc


class _Path(NamedTuple):
    """The way of a joint from a knot, at a time [s], to rest at a position [rad]."""

    since: float
    duration_s: float
    start: Knot
    position: float

    def at(self, t: float) -> Knot:
        """Return position, velocity and acceleration at a time [s]."""
        end = (self.position, 0.0, 0.0)
        if t - self.since >= self.duration_s:
            return end
        return evaluate(quintic(self.start, end, self.duration_s), t - self.since)


class _State(msgspec.Struct, forbid_unknown_fields=True):
    """paths: index of a joint → its way. last: the newest reference, and its time [s]."""

    paths: dict[int, _Path] = {}
    last: tuple[float, JointReference] | None = None


class Targets:
    """Positions that joints were sent to, instead of following the task.

    joints: of the reference, in its order. state: of it at the newest step. pending: indices of
    joints, position [rad] or None, and duration [s] of calls since then.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self.state = _State()
        self.pending: list[tuple[Sequence[int], float | None, float]] = []

    def set_target(self, joint: str, position: float | str, duration_s: float = 0.0) -> None:
        """Send a joint to a position [rad], with minimum jerk over a time [s]; 0: at once.

        position: a number, or degrees such as `30deg`. Raises CallError for an unknown joint, or
        what is no number.
        """
        index, angle = self._index(joint), _radians(position)
        numbers = [n for n in (angle, duration_s) if isinstance(n, int | float)]
        is_right = len(numbers) == 2 and not any(isinstance(n, bool) for n in numbers)
        if not is_right or not all(map(math.isfinite, numbers)) or duration_s < 0:
            raise CallError(
                f"{joint}: {angle!r} rad in {duration_s!r} s is not a valid target; "
                "both must be finite, the duration at least 0"
            )
        self.pending.append(([index], float(angle), duration_s))

    def follow_task(self, joint: str | None = None) -> None:
        """Return a joint, or all of them, to the task."""
        indices = range(len(self._joints)) if joint is None else [self._index(joint)]
        self.pending.append((indices, None, 0.0))

    def _index(self, joint: str) -> int:
        if joint not in self._joints:
            raise CallError(f"joint {joint!r} is unknown{suggest(str(joint), self._joints)}")
        return self._joints.index(joint)

    def apply(self, t: float, task: JointReference) -> JointReference:
        """Return the reference of a time [s]; task: that of the task."""
        state, target = self.state, task
        for indices, position, duration_s in self.pending:
            for index in indices:
                state.paths.pop(index, None)
                if position is not None:
                    state.paths[index] = self._path(index, position, duration_s, t)
        self.pending.clear()
        if state.paths:
            rows = [list(task.position), list(task.velocity), list(task.acceleration)]
            for index, path in state.paths.items():
                for row, value in zip(rows, path.at(t), strict=True):
                    row[index] = value
            target = JointReference(position=rows[0], velocity=rows[1], acceleration=rows[2])
        state.last = t, target
        return target

    def _path(self, index: int, position: float, duration_s: float, t: float) -> _Path:
        if self.state.last is None or not duration_s:
            return _Path(t, 0.0, (0.0, 0.0, 0.0), position)
        since, last = self.state.last
        start = (last.position[index], last.velocity[index], last.acceleration[index])
        return _Path(since, duration_s, start, position)


class _Saved(msgspec.Struct, forbid_unknown_fields=True):
    """The state of a mission at a checkpoint.

    params: with those that calls have set. shift: of `Sine`. targets: of `Targets`.
    """

    params: dict[str, Any]
    shift: list[float]
    targets: _State
    is_done: bool


class Mission(Participant):
    """Publishes a reference at every step.

    Outputs: one JointReference/1 and, optionally, one Event/1 that reports the start and the end.
    Ports can have any name. There are no inputs. Calls move a joint to a position and set
    parameters of the task; a change of `omega` keeps the phase of the sine continuous.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._reference_port = ports.output_of("JointReference/1")
        self._event_port = ports.optional_output_of("Event/1")
        ports.outputs_are("JointReference/1", "Event/1")
        params = config.read(Params, ports.problems)
        self._joints = [params.prefix + joint for joint in params.joints]
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
        t_ns = step.t_ns
        reference = self._reference(t_ns * 1e-9)
        self._check(reference, step)
        messages: dict[str, Message] = {self._reference_port: reference}
        if step.index == 0:
            self._report(messages, f"{self._task} of {', '.join(self._joints)} starts")
        if t_ns >= self._done_ns and not self._is_done:
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
            if isinstance(self.generator, Sine) and isinstance(params, SineParams):
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
                "JOINT POSITION [SECONDS]: moves a joint to a position [rad], or in degrees such "
                "as 30deg, with minimum jerk over a duration (default: at once), and holds it",
                changes=True,
            ),
            "follow_task": Method(
                self._targets.follow_task,
                "[JOINT]: makes one joint, or all, follow the task again, at once",
                changes=True,
            ),
            **self._steering.methods(),
        }

    def save(self) -> bytes | None:
        """Return what calls have changed; None with a generator of one's own, which has no such.

        None, too, while a call waits for its step.
        """
        if self._task not in TASKS or self._changed is not None or self._targets.pending:
            return None
        shift = self.generator.shift if isinstance(self.generator, Sine) else []
        saved = _Saved(self._steering.save(), shift, self._targets.state, self._is_done)
        return msgspec.msgpack.encode(saved)

    def restore(self, state: bytes) -> None:
        """Take what `save` returned."""
        saved = msgspec.msgpack.decode(state, type=_Saved)
        params = self._steering.restore(saved.params)
        self.generator = make_generator(self.config, params)
        if isinstance(params, SineParams):
            self.generator = Sine(params.joints, params, saved.shift)
        self._targets.state = saved.targets
        self._is_done = saved.is_done

    def _report(self, messages: dict[str, Message], text: str) -> None:
        if self._event_port is not None:
            messages[self._event_port] = Event(level="info", text=text)

    def _check(self, reference: JointReference, step: Step) -> None:
        """Raise RunError for a wrong length or value."""
        q, v, a = reference.position, reference.velocity, reference.acceleration
        count = len(self._joints)
        if not len(q) == len(v) == len(a) == count:
            raise RunError(
                f"{self.config.name}: step {step.index}: {self._task} returned "
                f"{[len(q), len(v), len(a)]} values of position, velocity, acceleration for "
                f"{count} joints"
            )
        if not all(map(math.isfinite, [*q, *v, *a])):
            raise RunError(
                f"{self.config.name}: step {step.index}: {self._task} returned a value that is "
                f"not finite: {reference}"
            )


def make_generator(config: Config, params: Params) -> Generator:
    """Return the generator of a task; raises SettingsError for invalid parameters."""
    problems = config.problems().below(("params",))
    generator: Generator | None
    if params.task in TASKS:
        make = partial(TASKS[params.task], params.joints, params)
        generator = problems.attempt(("file",), make)
    else:
        generator = make_plugin(config, "task", params.task, params.own, "at", params.joints)
    if generator is None:
        raise problems.error()
    if params.end_when_done and math.isinf(duration_of(generator)):
        problems.add(("end_when_done",), "is true, but this task never ends")
    problems.refuse()
    return generator
