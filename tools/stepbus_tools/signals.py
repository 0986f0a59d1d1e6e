"""Joints over time: what is measured, wanted and commanded, and how well they follow."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording import BATCH_BYTES, Batch, Port, Recording

Array = NDArray[np.float64]

_STATE = ("JointState/1", ("position", "velocity", "effort", "target"))
_REFERENCE = ("JointReference/1", ("position", "velocity", "acceleration"))
_COMMAND = ("JointCommand/1", ("mode", "values"))


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One port over time, or a piece of it.

    names: of the joints. steps: shape (m,). t: simulation time, shape (m,), [s]. fields:
    quantity → values, shape (m, n). limits: as in the port's description. joint_types: joint → its
    type, where the description gives it. modes: those in it, of a command. before: what a piece
    follows, its last message alone. end: the step up to which the last value of all holds; as
    long as between the first two without.
    """

    names: Sequence[str]
    steps: NDArray[np.int64]
    t: Array
    fields: Mapping[str, Array]
    limits: Mapping[str, Sequence[float]] = field(default_factory=dict)
    joint_types: Mapping[str, str] = field(default_factory=dict)
    modes: frozenset[str] = frozenset()
    before: Signal | None = None
    end: int | None = None

    def of(self, quantity: str, joint: str) -> Array | None:
        """Return one quantity of one joint, shape (m,); None where there is none."""
        if quantity not in self.fields or joint not in self.names:
            return None
        values: Array = self.fields[quantity][:, list(self.names).index(joint)]
        return values

    def held_at(self, steps: NDArray[np.int64], quantity: str, joint: str) -> Array:
        """Return a quantity of a joint at other steps, held until the next; NaN outside."""
        parts = [part for part in (self.before, self) if part is not None]
        rows = [row for part in parts if (row := part.of(quantity, joint)) is not None]
        known = np.concatenate([part.steps for part in parts])
        values = np.concatenate(rows) if rows else np.empty(0)
        if not len(values) or len(values) != len(known):
            return np.full(len(steps), np.nan)
        index = np.searchsorted(known, steps, side="right") - 1
        end = self.end if self.end is not None else known[-1] + _interval(known)
        held: Array = np.where((index >= 0) & (steps < end), values[np.maximum(index, 0)], np.nan)
        return held

    def slice(self, rows: slice) -> Signal:
        """Return some of its messages."""
        fields = {quantity: values[rows].copy() for quantity, values in self.fields.items()}
        return replace(self, steps=self.steps[rows].copy(), t=self.t[rows].copy(), fields=fields)


def _interval(steps: NDArray[np.int64]) -> int:
    """Return how many steps lie between the first two messages; 1 where there are fewer."""
    return int(steps[1] - steps[0]) if len(steps) > 1 else 1


def read_signal(port: Port, source: Port | Batch, quantities: Sequence[str]) -> Signal | None:
    """Return a port as arrays; None when it has no messages, or none of a constant width.

    source: what is read: the port itself, or a piece of it.
    """
    arrays = source.arrays(*quantities)
    if not len(source.steps):
        return None
    fields = {
        quantity: values.astype(float)
        for quantity, values in arrays.items()
        if values is not None and values.dtype != object and values.ndim == 2
    }
    width = max((values.shape[1] for values in fields.values()), default=0)
    names = port.names or [f"joint {i + 1}" for i in range(width)]
    if any(values.shape[1] != len(names) for values in fields.values()):
        return None
    described = port.description
    types = dict(zip(names, described.details.get("type", []), strict=False))
    modes = arrays.get("mode")
    return Signal(
        names=names,
        steps=source.steps,
        t=source.t,
        fields=fields,
        limits=described.limits,
        joint_types=types,
        modes=frozenset() if modes is None else frozenset(modes),
    )


class _OfJoints(Protocol):
    """A port of joints: `Signal`, or its curves."""

    @property
    def names(self) -> Sequence[str]: ...
    @property
    def joint_types(self) -> Mapping[str, str]: ...


_P = TypeVar("_P", bound=_OfJoints)


class JointPorts(Generic[_P]):
    """The ports that the classic plots of joint control need, by topic.

    states, references: every port that has joints the ports before it lack: those of several plants
    and missions, one for each robot. commands: all ports of commands.
    """

    states: Mapping[str, _P]
    references: Mapping[str, _P]
    commands: Mapping[str, _P]

    @property
    def measured(self) -> list[str]:
        """Return the joints that are measured, in the order of the states."""
        return list(dict.fromkeys(name for state in self.states.values() for name in state.names))

    @property
    def joints(self) -> list[str]:
        """Return the joints that are both measured and in a reference."""
        wanted = {name for reference in self.references.values() for name in reference.names}
        return [name for name in self.measured if name in wanted]

    def state_of(self, joint: str) -> _P | None:
        """Return the state that measures a joint."""
        return next((state for state in self.states.values() if joint in state.names), None)

    def reference_of(self, joint: str) -> _P | None:
        """Return the reference of a joint."""
        return next((wanted for wanted in self.references.values() if joint in wanted.names), None)

    def unit(self, joint: str) -> str:
        """Return the unit of a joint's position: m for a prismatic joint, else rad."""
        state = self.state_of(joint)
        is_prismatic = state is not None and state.joint_types.get(joint) == "prismatic"
        return "m" if is_prismatic else "rad"


@dataclass(frozen=True, kw_only=True)
class Tracking(JointPorts[Signal]):
    """The signals of joints and their tracking errors, or a piece of them."""

    states: Mapping[str, Signal] = field(default_factory=dict)
    references: Mapping[str, Signal] = field(default_factory=dict)
    commands: Mapping[str, Signal] = field(default_factory=dict)

    def error(self, joint: str) -> Array:
        """Return reference minus measured position, shape (m,), at the steps of the state."""
        state, reference = self.state_of(joint), self.reference_of(joint)
        measured = None if state is None else state.of("position", joint)
        if state is None or reference is None or measured is None:
            return np.full(0 if state is None else len(state.steps), np.nan)
        return reference.held_at(state.steps, "position", joint) - measured


def read_tracking(recording: Recording) -> Tracking:
    """Return the joint signals of a recording in one piece; what it takes grows with its length."""
    pieces = tracking_pieces(recording, sys.maxsize)
    return next(pieces, Tracking())


def tracking_pieces(
    recording: Recording, most_bytes: int = BATCH_BYTES, *, has_commands: bool = True
) -> Iterator[Tracking]:
    """Yield the joint signals of a recording, piece by piece; a short one is one piece."""
    states, references = (_with_joints(recording.of_type(name)) for name, _ in (_STATE, _REFERENCE))
    commands = recording.of_type(_COMMAND[0]) if has_commands else []
    held = [_Held(port) for port in references]
    for batch in recording.batches([*states, *references, *commands], most_bytes):
        yield Tracking(
            states=_present((p.topic, read_signal(p, batch[p.topic], _STATE[1])) for p in states),
            references=_present((one.topic, one.take(batch[one.topic])) for one in held),
            commands=_present(
                (p.topic, read_signal(p, batch[p.topic], _COMMAND[1])) for p in commands
            ),
        )


def _with_joints(ports: Iterable[Port]) -> list[Port]:
    """Return the ports with messages that have joints which those before them lack."""
    jointed: list[Port] = []
    known: set[str] = set()
    for port in ports:
        # One without names has joints that only its messages number.
        is_new = not set(port.names) <= known if port.names else not jointed
        if port.last_step >= 0 and is_new:
            jointed.append(port)
            known |= set(port.names)
    return jointed


def _present(signals: Iterable[tuple[str, Signal | None]]) -> dict[str, Signal]:
    return {topic: signal for topic, signal in signals if signal is not None}


class _Held:
    """The pieces of a reference, each of which knows what it follows."""

    def __init__(self, port: Port) -> None:
        self.topic = port.topic
        self._port = port
        self._interval = 0
        self._before: Signal | None = None

    def take(self, batch: Batch) -> Signal | None:
        """Return a piece; one without messages where the last one still holds."""
        before = self._before
        signal = read_signal(self._port, batch, _REFERENCE[1])
        if signal is None and before is not None and not len(batch.steps):
            signal = before.slice(slice(0, 0))
        if signal is None:
            return None
        if not self._interval:
            first = [] if before is None else [before.steps]
            steps = np.concatenate([*first, signal.steps])
            self._interval = _interval(steps) if len(steps) > 1 else 0
        end = self._port.last_step + (self._interval or 1)
        if len(signal.steps):
            self._before = signal.slice(slice(-1, None))
        return replace(signal, before=before, end=end)


class TrackingError:
    """The root mean square of each joint's tracking error.

    after_s: what comes before is left out [s]. The closing sample has no reference and is left
    out too. Of a recording in several pieces the sum may differ from that in one in the last
    digits of a double.
    """

    def __init__(self, after_s: float) -> None:
        self._after_s = after_s
        self._sums: dict[str, tuple[float, int]] = {}

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        for joint in piece.joints:
            state, reference = piece.state_of(joint), piece.reference_of(joint)
            if state is None or reference is None or "position" not in state.fields:
                continue
            has_reference = ~np.isnan(reference.held_at(state.steps, "position", joint))
            # A measured NaN counts.
            error = piece.error(joint)[has_reference & (state.t >= self._after_s)]
            total, count = self._sums.get(joint, (0.0, 0))
            # A simulation that diverges leaves numbers whose squares are too large for any.
            with np.errstate(over="ignore"):
                squares = float(np.sum(error**2))
            self._sums[joint] = (total + squares, count + len(error))

    def rmse(self) -> dict[str, float]:
        """Return joint → root mean square [rad or m]; none for a joint without a reference."""
        return {
            joint: float(np.sqrt(total / count))
            for joint, (total, count) in self._sums.items()
            if count
        }


def tracking_rmse(tracking: Tracking, after_s: float = 2.0) -> dict[str, float]:
    """Return the root mean square of each joint's tracking error in one piece [rad or m]."""
    error = TrackingError(after_s)
    error.take(tracking)
    return error.rmse()
