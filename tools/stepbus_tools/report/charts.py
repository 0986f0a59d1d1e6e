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
from stepbus_tools.columns import Table, limits_of, readable
from stepbus_tools.report.curves import FieldCurve, JointCurves, Line, PortCurves, SignalCurves

Role = Literal["measured", "error", "reference", "command", "target"]
"""What a line is: what was, what it was apart from what it should be, or what it should be."""

_MOST_JOINTS = 20
_NO_UNIT = "-"
"""As columns have it."""
_NEAR = 0.6
"""Share of a limit from which on it is drawn."""
_SIGNAL = re.compile(r"([\w-]+)[./]([\w-]+)(?:\.(\w+))?(?:\[(.+)\])?")
_WANTED: Sequence[tuple[Role, str]] = (("reference", "reference"), ("command", "commanded"))


@dataclass(frozen=True)
class ChartLine:
    """A line of a chart. points: times [s] and values.

    number: of its style, see `theme.line_style`. run: among several.
    """

    label: str
    points: Line
    role: Role = "measured"
    number: int = 0
    run: int = 0

    @property
    def is_solid(self) -> bool:
        """Return whether it is what was; else it is what should have been."""
        return self.role in {"measured", "error"}

    @property
    def is_wide(self) -> bool:
        """Return whether it is drawn wide and light: what was commanded."""
        return self.role in {"reference", "command"}


@dataclass(frozen=True)
class Chart:
    """Lines over time. unit: of their values; may be empty. limits: of them, where there are.

    is_path: its lines are no values over time, but x and y, both in its unit.
    """

    title: str
    unit: str
    lines: Sequence[ChartLine]
    limits: Sequence[float] = ()
    is_path: bool = False

    @property
    def drawn(self) -> Sequence[ChartLine]:
        """Return its lines in the order to draw them: what should be lies below what was."""
        return sorted(self.lines, key=lambda line: (line.is_solid, not line.is_wide))

    @property
    def largest(self) -> float:
        """Return the largest absolute value of all lines."""
        sizes = (float(np.nanmax(np.abs(line.points[1]), initial=0.0)) for line in self.lines)
        return max((size for size in sizes if np.isfinite(size)), default=0.0)

    @property
    def varies(self) -> bool:
        """Return whether any line is more than one value all the time."""
        values = (line.points[1][np.isfinite(line.points[1])] for line in self.lines)
        return any(len(row) > 0 and bool(np.ptp(row) > 0) for row in values)

    @property
    def used(self) -> float | None:
        """Return which share of the range between its limits the measured lines use.

        None without two limits, or without a measured line.
        """
        if len(self.limits) != 2 or not self.limits[0] < self.limits[1]:
            return None
        middle, half = sum(self.limits) / 2, (self.limits[1] - self.limits[0]) / 2
        shares = [
            float(np.nanmax(np.abs(line.points[1] - middle))) / half
            for line in self.lines
            if line.role == "measured" and np.isfinite(line.points[1]).any()
        ]
        return max(shares, default=None)

    @property
    def is_near_limit(self) -> bool:
        """Return whether a line comes so near to a limit that both belong in one picture."""
        return self.used is not None and self.used >= _NEAR


@dataclass(frozen=True, kw_only=True)
class Mark:
    """An event of a run, or another time that all charts show [s].

    level: info, warning, error, goal, call, fault, failure, divergence, or empty. source: of an
    event: a participant, or its port.
    """

    t: float
    level: str = ""
    text: str = ""
    source: str = ""

    @property
    def sentence(self) -> str:
        """Return its text, after its source."""
        return f"{self.source}: {self.text}" if self.source else self.text

    @property
    def label(self) -> str:
        """Return its time, its level and its first line."""
        return f"{self.t:.3f} s {self.level}: {(self.sentence.splitlines() or [''])[0]}"


def path_of(port: PortCurves) -> Line | None:
    """Return x and y of where a base was [m]; None of another port."""
    if port.port.type != "BaseState/1" or not {"x", "y"} <= port.fields.keys():
        return None
    (tx, x), (ty, y) = (port.fields[name].curve.line(0) for name in ("x", "y"))
    t = np.union1d(tx, ty)
    return np.interp(t, tx, x), np.interp(t, ty, y)


def joint_charts(curves: JointCurves, joint: str) -> list[Chart]:
    """Return error, position, velocity and torque, or force, of a joint; some may be empty."""
    state, reference = curves.state_of(joint), curves.reference_of(joint)
    unit, number = curves.unit(joint), curves.measured.index(joint)

    def of(port: SignalCurves | None, quantity: str) -> Line | None:
        return None if port is None else port.of(quantity, joint)

    def chart(title: str, unit: str, limited: str, *rows: _Row) -> Chart:
        return Chart(title, unit, _lines(rows, number), _limits(state, joint, limited))

    commands: list[_Row] = [
        (f"command {index or ''}".strip(), of(port, "values"), "command")
        for index, port in enumerate(curves.torques)
    ]
    return [
        chart("error", unit, "", ("error", curves.error(joint), "error")),
        chart(
            "position",
            unit,
            "position",
            ("measured", of(state, "position"), "measured"),
            ("reference", of(reference, "position"), "reference"),
            ("target", of(state, "target"), "target"),
        ),
        chart(
            "velocity",
            f"{unit}/s",
            "velocity",
            ("measured", of(state, "velocity"), "measured"),
            ("reference", of(reference, "velocity"), "reference"),
        ),
        chart(
            "force" if unit == "m" else "torque",
            "N" if unit == "m" else "N·m",
            "effort",
            ("applied", of(state, "effort"), "measured"),
            *commands,
        ),
    ]


_Row = tuple[str, Line | None, Role]
"""Label, points and role of a line that may be absent."""


def _lines(rows: Iterable[_Row], number: int) -> list[ChartLine]:
    """Return the lines that have any value. number: of their style."""
    shown = [(name, row, role) for name, row, role in rows if row and np.isfinite(row[1]).any()]
    return [ChartLine(name, row, role, number) for name, row, role in shown]


def _limits(state: SignalCurves | None, joint: str, quantity: str) -> list[float]:
    """Return the limits of a joint that are finite."""
    if state is None:
        return []
    ends = limits_of(state.limits, quantity, state.names.index(joint))
    return [value for value in ends if np.isfinite(value)]


def all_joints(curves: JointCurves) -> Iterator[Chart]:
    """Yield the charts of all joints, one for each quantity; sliding joints have their own.

    Of more than twenty joints, the first are shown.
    """
    for unit in ("rad", "m"):
        joints = [name for name in curves.measured if curves.unit(name) == unit]
        cut = f" (first {_MOST_JOINTS} of {len(joints)} joints)"
        more = cut if len(joints) > _MOST_JOINTS else ""
        shown = [joint_charts(curves, joint) for joint in joints[:_MOST_JOINTS]]
        for charts in zip(*shown, strict=True):
            yield from _united(joints, charts, "reference" if curves.joints else "target", more)


def _united(
    joints: Sequence[str], charts: Sequence[Chart], wanted: str, more: str
) -> Iterator[Chart]:
    """Yield the chart of a quantity of several joints, where it is measured."""
    first, solid, wide = charts[0], list[ChartLine](), list[ChartLine]()
    for joint, chart in zip(joints, charts, strict=False):
        points = {line.role: line.points for line in reversed(chart.lines)}
        shown = points.get("measured") or points.get("error")
        if shown is None and "command" in points:
            shown = points.pop("command")
        number = chart.lines[0].number if chart.lines else 0
        solid += [ChartLine(joint, shown, number=number)] if shown else []
        for role, label in _WANTED:
            wide += [ChartLine(label, points[role], role, number)] if role in points else []
    if solid:
        title = f"error: {wanted} − measured" if first.title == "error" else first.title
        yield Chart(title + more, first.unit, [*solid, *wide])


def field_chart(field: FieldCurve, most: int) -> Chart:
    """Return the chart of a field of a port. most: lines."""
    lines = [
        ChartLine(label, points, number=number)
        for number, label in enumerate(field.labels[:most])
        if np.isfinite((points := field.curve.line(number))[1]).any()
    ]
    units = set(field.units) - {_NO_UNIT}
    return Chart(field.title, units.pop() if len(units) == 1 else "", lines)


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
        raise WiringError(f"{text!r} is not a signal; write e.g. plant.joint_state.position[0]")
    participant, name, field, index = form.groups()
    port = recording[f"{participant}/{name}"]
    curves = PortCurves(Table(port), sys.maxsize, points=sys.maxsize)
    for piece in recording.batches([port]):
        curves.take(piece[port.topic])
    if field is not None and field not in curves.fields:
        others = f"; it has {', '.join(curves.fields) or 'none'}"
        raise WiringError(f"{text}: {port.type} has no numeric field {field!r}{others}")
    if not curves.fields:
        raise WiringError(f"{text}: {port.type} has no numeric fields to plot")
    chosen = [curves.fields[field]] if field else curves.fields.values()
    return [chart for one in chosen for chart in _signal(curves.name, one, index, text)]


def _signal(port: str, field: FieldCurve, index: str | None, text: str) -> list[Chart]:
    title, labels = f"{port}.{field.title}", list(field.labels)
    is_single = labels == [field.title]
    numbers = range(len(labels))[:_MOST_JOINTS]
    if index is not None:
        by_number = [str(number) for number in range(len(labels))]
        at = next((own.index(index) for own in (by_number, labels) if index in own), -1)
        if is_single or at < 0:
            shown = () if is_single else labels
            names = ", ".join(one if one.startswith("[") else f"[{one}]" for one in shown)
            raise WiringError(f"{text}: no element [{index}]; it has {names or 'a single number'}")
        numbers = range(at, at + 1)
    lines = dict[str, list[ChartLine]]()
    for i in numbers:
        line = ChartLine(title if is_single else labels[i], field.curve.line(i), number=i)
        lines.setdefault(field.units[i], []).append(line)
    return [Chart(title, unit, same) for unit, same in lines.items()]
