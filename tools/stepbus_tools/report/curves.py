"""The curves of a recording: few points that look like all of them, in little memory."""

import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_orchestrator.recording import Batch, Port, Recording
from stepbus_schemas import StepbusError
from stepbus_tools.columns import Table
from stepbus_tools.signals import Array, JointPorts, Signal, Tracking

Line = tuple[Array, Array]
"""Times [s] and values, both of shape (p,)."""

_MOST_POINTS = 8000
_TORQUE_ONLY = frozenset(("torque", "brake"))


class Curve:
    """Several lines over time, in memory that does not grow with their length.

    Up to `most` points all are there. Of more, each line has the least and the largest of each
    bucket; the buckets double whenever they are too many. count: of points that were added.
    """

    def __init__(self, most: int = _MOST_POINTS) -> None:
        self.count = 0
        self._most = most
        # Both of shape (2, p, n): times and values of p points of n lines.
        self._kept: Array | None = None
        self._rest: Array | None = None
        self._bucket = 1

    def add(self, t: Array, values: Array) -> None:
        """Add points. t: shape (m,), [s]. values: shape (m, n)."""
        self.count += len(t)
        times = np.broadcast_to(t[:, None], values.shape)
        rest = self._rest = _joined(self._rest, np.stack((times, values)))
        if self._bucket == 1 and rest.shape[1] > self._most:
            self._bucket = 4
        if self._bucket > 1:
            self._reduce(rest)

    def line(self, index: int) -> Line:
        """Return (t [s], values), each shape (p,), of line `index`."""
        if self._rest is None:
            return np.empty(0), np.empty(0)
        t, values = _joined(self._kept, self._rest)[:, :, index]
        return t, values

    def _reduce(self, rest: Array) -> None:
        """Put points into buckets, of which two points are kept each."""
        most = self._most // 4 * 2
        while rest.shape[1] >= self._bucket:
            held = 0 if self._kept is None else self._kept.shape[1] // 2
            count = min(rest.shape[1] // self._bucket, most - held)
            full = rest[:, : count * self._bucket]
            rest = rest[:, count * self._bucket :]
            self._kept = _joined(self._kept, _extremes(full, self._bucket))
            if held + count == most:
                self._kept = _extremes(self._kept, 4)
                self._bucket *= 2
        self._rest = rest.copy()


def _extremes(points: Array, size: int) -> Array:
    """Return the least and the largest of each `size` points, in their order."""
    groups = points.reshape(2, -1, size, points.shape[2])
    filled = np.where(np.isnan(groups[1]), 0.0, groups[1])
    at = np.sort(np.stack([filled.argmin(axis=1), filled.argmax(axis=1)], axis=1), axis=1)
    at = np.broadcast_to(at, (2, *at.shape))
    chosen: Array = np.take_along_axis(groups, at, axis=2)
    return chosen.reshape(2, -1, points.shape[2])


def _joined(first: Array | None, then: Array) -> Array:
    return then if first is None else np.concatenate((first, then), axis=1)


@dataclass(frozen=True, kw_only=True)
class FieldCurve:
    """The curves of one field. labels: of all its numbers, of which the first may have curves.

    units: of these.
    """

    title: str
    units: Sequence[str]
    labels: Sequence[str]
    curve: Curve


class PortReader(ABC):
    """Reads one port for a report. problem: why it is not read to its end; or empty."""

    def __init__(self, port: Port) -> None:
        self.port = port
        self.problem = ""

    @abstractmethod
    def take(self, batch: Batch) -> None:
        """Add the next batch; raises MessageError for a message that cannot be read."""


def read_ports(recording: Recording, readers: Sequence[PortReader]) -> float:
    """Give each reader all messages of its port; return the last time [s]."""
    end_s = 0.0
    for piece in recording.batches({reader.port: None for reader in readers}):
        for reader in readers:
            batch = piece[reader.port.topic]
            if len(batch.steps) and not reader.problem:
                end_s = max(end_s, float(batch.t[-1]))
                try:
                    reader.take(batch)
                except StepbusError as exc:
                    reader.problem = str(exc)
    return end_s


class PortCurves(PortReader):
    """The curves of the numbers of one port; fields: by title.

    most: lines of a field; the others of a field have none. widest: a field with more numbers has
    no curve. points: of a line.
    """

    def __init__(
        self, table: Table, most: int, *, widest: int = sys.maxsize, points: int = _MOST_POINTS
    ) -> None:
        super().__init__(table.port)
        self.name = table.name
        self.fields: dict[str, FieldCurve] = {}
        self._table = table
        self._read = [f for f in table.fields if f.is_numeric and len(f.columns) <= widest]
        self._most, self._widest, self._points = most, widest, points

    def take(self, batch: Batch) -> None:
        """Add the next batch; raises MessageError for a message that cannot be read."""
        for field, values in list(self._table.numbers(batch, self._read)):
            width = 0 if values is None else values.shape[1]
            known = self.fields.get(field.name)
            if values is None or width > self._widest or (known and len(known.labels) != width):
                # Its length changes, or the reader could not tell its lines apart.
                self._read.remove(field)
                self.fields.pop(field.name, None)
            elif known or not np.isnan(values).all():
                units = [one.unit for one in field.columns] if field.is_flat else []
                units = units or [field.columns[0].unit] * width
                self._add(batch, field.name, units, field.labels(width), values[:, : self._most])

    def _add(
        self, batch: Batch, title: str, units: Sequence[str], labels: Sequence[str], values: Array
    ) -> None:
        made = FieldCurve(title=title, units=units, labels=labels, curve=Curve(self._points))
        self.fields.setdefault(title, made).curve.add(batch.t, values)


class ContactCurves(PortCurves):
    """How many contacts there are, and how hard."""

    def take(self, batch: Batch) -> None:
        """Add the next batch; raises MessageError for a message that cannot be read."""
        messages: list[Any] = list(batch.messages())
        rows = np.array([(len(m.pairs), sum(m.force), max(m.peaks, default=0.0)) for m in messages])
        self._add(batch, "pairs in contact", [""], ["pairs"], rows[:, :1])
        self._add(batch, "normal force", ["N", "N"], ["sum", "peak"], rows[:, 1:])


class SignalCurves:
    """The curves of a port of joints: all that `Signal` says of it, thinned for a plot."""

    def __init__(self, first: Signal) -> None:
        self.names = list(first.names)
        self.limits: Mapping[str, Sequence[float]] = first.limits
        self.joint_types: Mapping[str, str] = first.joint_types
        self.modes: set[str] = set()
        self._curves: dict[str, Curve] = {}
        self._count = 0

    def take(self, signal: Signal) -> None:
        """Take the next piece."""
        self._count += len(signal.t)
        if list(signal.names) != self.names:
            return
        self.modes |= signal.modes
        fields = dict(signal.fields)
        if "position" in fields and "velocity" not in fields and len(signal.t) > 1:
            # Where it is not sensed, it is the finite difference of positions.
            fields["velocity"] = np.gradient(fields["position"], signal.t, axis=0)
        for quantity, values in fields.items():
            self._curves.setdefault(quantity, Curve()).add(signal.t, values)

    def of(self, quantity: str, joint: str) -> Line | None:
        """Return (t [s], values) of a quantity of a joint; None where any message lacks it."""
        curve = self._curves.get(quantity)
        if curve is None or curve.count != self._count or joint not in self.names:
            return None
        return curve.line(self.names.index(joint))


class JointCurves(JointPorts[SignalCurves]):
    """The curves of joints and their tracking errors. end_s: of the last state [s]."""

    def __init__(self) -> None:
        self.states: dict[str, SignalCurves] = {}
        self.references: dict[str, SignalCurves] = {}
        self.commands: dict[str, SignalCurves] = {}
        self.end_s = 0.0
        self._errors: dict[str, Curve] = {}

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        for known, signals in (
            (self.states, piece.states),
            (self.references, piece.references),
            (self.commands, piece.commands),
        ):
            for topic, signal in signals.items():
                known.setdefault(topic, SignalCurves(signal)).take(signal)
        self.end_s = max([self.end_s, *(float(state.t[-1]) for state in piece.states.values())])
        for joint in piece.joints or piece.measured:
            state = piece.state_of(joint)
            if state is not None:
                error = piece.error(joint) if piece.joints else _behind(state, joint)
                self._errors.setdefault(joint, Curve()).add(state.t, error[:, None])

    @property
    def torques(self) -> list[SignalCurves]:
        """Return the ports that only command torques, or brake."""
        commands = self.commands.values()
        return [one for one in commands if "torque" in one.modes and one.modes <= _TORQUE_ONLY]

    def error(self, joint: str) -> Line | None:
        """Return reference minus measured position; without references, the targets of motors."""
        return self._errors[joint].line(0) if joint in self._errors else None


def _behind(state: Signal, joint: str) -> Array:
    """Return target minus measured position of a joint, shape (m,) [rad or m]."""
    target, position = state.of("target", joint), state.of("position", joint)
    unknown = np.full(len(state.t), np.nan)
    return unknown if target is None or position is None else target - position
