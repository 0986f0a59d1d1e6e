"""What is drawn of a recording: charts of its joints, of its ports, of signals that a user names.

Every picture and page takes these; how a chart looks is up to what draws it.
"""

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import WiringError
from stepbus_tools.columns import Table, readable
from stepbus_tools.report.curves import FieldCurve, JointCurves, Line, PortCurves, SignalCurves

Role = Literal["measured", "error", "reference", "command", "target"]
"""What a line is: what was, what it was apart from what it should be, or what it should be."""

_MOST_JOINTS = 20
_SIGNAL = re.compile(r"([\w-]+)[./]([\w-]+)(?:\.(\w+))?(?:\[([^\[\]]+)\])?")
_DASHED: Sequence[tuple[Role, str]] = (("reference", "reference"), ("command", "commanded"))


@dataclass(frozen=True)
class ChartLine:
    """A line of a chart. points: times [s] and values."""

    label: str
    points: Line
    role: Role = "measured"


@dataclass(frozen=True)
class Chart:
    """Lines over time. unit: of their values; may be empty. limits: of them, where there are."""

    title: str
    unit: str
    lines: Sequence[ChartLine]
    limits: Sequence[float] = ()


def joint_charts(curves: JointCurves, joint: str) -> list[Chart]:
    """Return error, position, velocity and torque, or force, of a joint; some may be empty."""
    state, reference = curves.state_of(joint), curves.reference_of(joint)
    is_sliding = curves.is_prismatic(joint)
    unit = "m" if is_sliding else "rad"

    def of(port: SignalCurves | None, quantity: str) -> Line | None:
        return None if port is None else port.of(quantity, joint)

    def chart(title: str, unit: str, limits: Sequence[str], *rows: _Row) -> Chart:
        return Chart(title, unit, _lines(rows), _limits(state, joint, limits))

    commands: list[_Row] = [
        (f"command {number or ''}".strip(), of(port, "values"), "command")
        for number, port in enumerate(curves.torques)
    ]
    return [
        chart("error", unit, (), ("error", curves.error(joint), "error")),
        chart(
            "position",
            unit,
            ("lower", "upper"),
            ("measured", of(state, "position"), "measured"),
            ("reference", of(reference, "position"), "reference"),
            ("target", of(state, "target"), "target"),
        ),
        chart(
            "velocity",
            f"{unit}/s",
            ("velocity",),
            ("measured", of(state, "velocity"), "measured"),
            ("reference", of(reference, "velocity"), "reference"),
        ),
        chart(
            "force" if is_sliding else "torque",
            "N" if is_sliding else "N·m",
            ("effort",),
            ("applied", of(state, "effort"), "measured"),
            *commands,
        ),
    ]


_Row = tuple[str, Line | None, Role]
"""Label, points and role of a line that may be absent."""


def _lines(rows: Iterable[_Row]) -> list[ChartLine]:
    """Return the lines that have any number."""
    return [ChartLine(n, row, role) for n, row, role in rows if row and np.isfinite(row[1]).any()]


def _limits(state: SignalCurves | None, joint: str, keys: Sequence[str]) -> list[float]:
    """Return the limits of a joint that are finite; of a single key, both signs of it."""
    if state is None:
        return []
    index = state.names.index(joint)
    rows = [state.limits.get(key, ()) for key in keys]
    numbers = [float(row[index]) for row in rows if len(row) > index]
    if len(keys) == 1:
        numbers += [-value for value in numbers]
    return sorted(value for value in numbers if np.isfinite(value))


def all_joints(curves: JointCurves) -> Iterator[Chart]:
    """Yield the charts of all joints, one for each quantity; sliding joints have their own.

    Of more than twenty joints, the first are shown.
    """
    for is_sliding in (False, True):
        joints = [name for name in curves.measured if curves.is_prismatic(name) == is_sliding]
        cut = f" (first {_MOST_JOINTS} of {len(joints)} joints)"
        more = cut if len(joints) > _MOST_JOINTS else ""
        shown = [joint_charts(curves, joint) for joint in joints[:_MOST_JOINTS]]
        for charts in zip(*shown, strict=True):
            yield from _united(joints, charts, "reference" if curves.joints else "target", more)


def _united(
    joints: Sequence[str], charts: Sequence[Chart], wanted: str, more: str
) -> Iterator[Chart]:
    """Yield the chart of a quantity of several joints, where it is measured."""
    first, solid, dashed = charts[0], list[ChartLine](), list[ChartLine]()
    for joint, chart in zip(joints, charts, strict=False):
        points = {line.role: line.points for line in reversed(chart.lines)}
        shown = points.get("measured") or points.get("error")
        if shown is None and "command" in points:
            shown = points.pop("command")
        solid += [ChartLine(joint, shown)] if shown else []
        for role, label in _DASHED:
            dashed += [ChartLine(label, points[role], role)] if role in points else []
    if solid:
        title = f"error: {wanted} − measured" if first.title == "error" else first.title
        yield Chart(title + more, first.unit, [*solid, *dashed])


def field_chart(field: FieldCurve, most: int) -> Chart:
    """Return the chart of a field of a port. most: lines."""
    rows: list[_Row] = [
        (label, field.curve.line(number), "measured")
        for number, label in enumerate(field.labels[:most])
    ]
    return Chart(field.title, field.unit, _lines(rows))


def signal_names(recording: Recording) -> list[str]:
    """Return every signal of a recording that can be plotted, as `participant.port.field`."""
    ports = [PortCurves(table, 1) for table in readable(recording)[0]]
    for piece in recording.batches([port.port for port in ports]):
        for port in ports:
            port.take(piece[port.port.topic])
    return [f"{port.name}.{title}" for port in ports for title in port.fields]


def find_signals(recording: Recording, text: str) -> list[Chart]:
    """Return what a text names: `participant.port`, `….field`, `….field[0]` or `….field[joint1]`.

    Raises WiringError where the recording has no such numbers, MessageError where they cannot be
    read.
    """
    form = _SIGNAL.fullmatch(text)
    if form is None:
        raise WiringError(f"{text!r} is no signal; write e.g. plant.joint_state.position[0]")
    participant, name, field, index = form.groups()
    port = recording[f"{participant}/{name}"]
    curves = PortCurves(Table(port), sys.maxsize, points=sys.maxsize)
    for piece in recording.batches([port]):
        curves.take(piece[port.topic])
    if field is not None and field not in curves.fields:
        others = f"; it has {', '.join(curves.fields) or 'none'}"
        raise WiringError(f"{text}: {port.type} has no numbers {field!r} here{others}")
    if not curves.fields:
        raise WiringError(f"{text}: {port.type} carries no numbers to plot")
    chosen = [curves.fields[field]] if field else curves.fields.values()
    return [_signal(curves.name, one, index, text) for one in chosen]


def _signal(port: str, field: FieldCurve, index: str | None, text: str) -> Chart:
    title, labels = f"{port}.{field.title}", list(field.labels)
    is_single = labels == [field.title]
    numbers = range(len(labels))[:_MOST_JOINTS]
    if index is not None:
        at = int(index) if index.isdecimal() else labels.index(index) if index in labels else -1
        if is_single or not 0 <= at < len(labels):
            names = "" if is_single else ", ".join(f"[{label.strip('[]')}]" for label in labels)
            raise WiringError(f"{text}: there is no [{index}]; it has {names or 'a single number'}")
        numbers = range(at, at + 1)
    lines = [ChartLine(title if is_single else labels[i], field.curve.line(i)) for i in numbers]
    return Chart(title, field.unit, lines)
