"""What is drawn of a recording: charts of its joints, of its ports, of signals that a user names.

Every picture and page takes these; how a chart looks is up to what draws it.
"""

import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import WiringError
from stepbus_tools.columns import Table, readable
from stepbus_tools.report.curves import FieldCurve, JointCurves, Line, PortCurves, SignalCurves

Role = Literal["measured", "error", "reference", "command", "target"]
"""What a line is: what was, what it was apart from what it should be, or what it should be."""

_MOST_JOINTS = 20
_SIGNAL = re.compile(r"([\w-]+)[./]([\w-]+)(?:\.(\w+))?(?:\[([^\[\]]+)\])?")
_DASHED = {"reference": "reference", "command": "commanded"}


@dataclass(frozen=True, kw_only=True)
class ChartLine:
    """A line of a chart. t: [s]; values: both of shape (p,)."""

    label: str
    t: Array
    values: Array
    role: Role = "measured"


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Lines over time. unit: of their values; may be empty. limits: of them, where there are."""

    title: str
    unit: str
    lines: Sequence[ChartLine]
    limits: Sequence[float] = ()


def joint_charts(curves: JointCurves, joint: str) -> list[Chart]:
    """Return error, position, velocity and torque, or force, of a joint; some may be empty."""
    state, reference = curves.state_of(joint), curves.reference_of(joint)
    unit, force = ("m", "N") if curves.is_prismatic(joint) else ("rad", "N·m")

    def chart(
        title: str, unit: str, rows: Sequence[tuple[str, Role, Line | None]], *limits: str
    ) -> Chart:
        lines = [_line(label, role, row) for label, role, row in rows if row and _is_finite(row)]
        return Chart(title=title, unit=unit, lines=lines, limits=_limits(state, joint, limits))

    def of(curves: SignalCurves | None, quantity: str) -> Line | None:
        return None if curves is None else curves.of(quantity, joint)

    commands = [of(port, "values") for port in curves.torques]
    return [
        chart("error", unit, [("error", "error", curves.error(joint))]),
        chart(
            "position",
            unit,
            [
                ("measured", "measured", of(state, "position")),
                ("reference", "reference", of(reference, "position")),
                ("target", "target", of(state, "target")),
            ],
            "lower",
            "upper",
        ),
        chart(
            "velocity",
            f"{unit}/s",
            [
                ("measured", "measured", of(state, "velocity")),
                ("reference", "reference", of(reference, "velocity")),
            ],
            "velocity",
        ),
        chart(
            "torque" if force == "N·m" else "force",
            force,
            [
                ("applied", "measured", of(state, "effort")),
                *((f"command {i or ''}".strip(), "command", c) for i, c in enumerate(commands)),
            ],
            "effort",
        ),
    ]


def _line(label: str, role: Role, line: Line) -> ChartLine:
    return ChartLine(label=label, role=role, t=line[0], values=line[1])


def _is_finite(line: Line) -> bool:
    """Return whether a line has any number."""
    return bool(np.isfinite(line[1]).any())


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
        by_role = {line.role: line for line in reversed(chart.lines)}
        shown = by_role.get("measured") or by_role.get("error")
        should = by_role.get("reference")
        if (command := by_role.get("command")) is not None:
            shown, should = (shown, command) if shown else (command, None)
        solid += [replace(shown, label=joint, role="measured")] if shown else []
        dashed += [replace(should, label=_DASHED[should.role])] if should else []
    if solid:
        title = f"error: {wanted} − measured" if first.title == "error" else first.title
        yield Chart(title=title + more, unit=first.unit, lines=[*solid, *dashed])


def field_chart(field: FieldCurve, most: int) -> Chart:
    """Return the chart of a field of a port. most: lines."""
    rows = [(label, field.curve.line(i)) for i, label in enumerate(field.labels[:most])]
    lines = [_line(label, "measured", row) for label, row in rows if _is_finite(row)]
    return Chart(title=field.title, unit=field.unit, lines=lines)


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
        at = {label: number for number, label in enumerate(labels)}.get(index, -1)
        at = int(index) if index.isdecimal() else at
        if is_single or not 0 <= at < len(labels):
            names = "" if is_single else ", ".join(f"[{label.strip('[]')}]" for label in labels)
            raise WiringError(f"{text}: there is no [{index}]; it has {names or 'a single number'}")
        numbers = range(at, at + 1)
    lines = [
        _line(title if is_single else labels[i], "measured", field.curve.line(i)) for i in numbers
    ]
    return Chart(title=title, unit=field.unit, lines=lines)
