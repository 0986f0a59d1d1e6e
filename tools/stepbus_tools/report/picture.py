"""Charts as one picture: report.png, `stepbus plot`."""

import io
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.run.result import Result
from stepbus_participant import ExtraMissing, need
from stepbus_schemas import SHIPPED, StepbusError
from stepbus_tools.report.charts import Chart, ChartLine, Mark, all_joints, field_chart, path_of
from stepbus_tools.report.curves import Curve, JointCurves, Line, PortCurves
from stepbus_tools.report.summary import NO_DYNAMICS, lacks_dynamics, scenario_name
from stepbus_tools.theme import LINES, PAPER, line_style, prefixed
from stepbus_tools.whole_file import replaced

_SIZE = (5.2, 2.7)
"""Of a panel [inch]."""
_MOST_COLUMNS = 3
_MOST_NAMES = 14
_MOST_ROWS = 8
_MARKS = {"failure": "bad", "error": "bad", "fault": "warn", "warning": "warn"}
"""Level of a mark → its colour."""
_NOWHERE: Line = (np.empty(0), np.empty(0))


def draw(
    title: str, charts: Sequence[Chart], form: str = "png", *, marks: Sequence[Mark] = ()
) -> bytes:
    """Return charts as a picture, in up to three columns. marks: of time, in all charts.

    form: `png`, `svg`, `pdf`. Raises ValueError for another, ExtraMissing without matplotlib.
    """
    _, figures = need("a plot", "matplotlib", "matplotlib.figure")
    columns = min(_MOST_COLUMNS, math.ceil(math.sqrt(len(charts))))
    rows = math.ceil(len(charts) / columns)
    size = (max(9.0, columns * _SIZE[0]), 0.8 + max(3.4 if rows == 1 else 0, rows * _SIZE[1]))
    figure = figures.Figure(figsize=size, dpi=110, layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    axes = figure.subplots(rows, columns, squeeze=False).flatten()
    span = _span(charts, marks)
    names = _shared_names(charts)
    for axis, chart in zip(axes, charts, strict=False):
        solid = {line.label for line in chart.lines if line.is_solid}
        _draw(axis, chart, is_named=not names.keys() >= solid)
        if chart.is_path:
            axis.set_aspect("equal", adjustable="datalim")
            axis.set(xlabel="x [m]", ylabel="y [m]")
            continue
        # What ended the run lies above all else.
        for mark in sorted(marks, key=lambda one: one.level == "failure"):
            _mark(axis, mark)
        axis.set_xlabel("time [s]")
        axis.set_xlim(*span)
    for axis in axes[len(charts) :]:
        axis.set_axis_off()
    # What was wanted has the colour of what was measured, so its legend is grey.
    wanted = {line.label: line for chart in charts for line in chart.lines if not line.is_solid}
    samples = {label: _look(ChartLine(label, _NOWHERE, number=n)) for label, n in names.items()}
    samples |= {name: _look(line) | {"color": PAPER["soft"]} for name, line in wanted.items()}
    if samples:
        handles = [axes[0].plot(*_NOWHERE, **look)[0] for look in samples.values()]
        place = {"loc": "outside lower left", "frameon": False, "fontsize": 9}
        figure.legend(handles, list(samples), ncols=min(7, len(handles)), **place)
    stream = io.BytesIO()
    figure.savefig(stream, format=form)
    return stream.getvalue()


def _mark(axis: Any, mark: Mark) -> None:
    color = PAPER[_MARKS.get(mark.level, "soft")]
    axis.axvline(mark.t, color=color, linewidth=1.2)
    side = "right" if mark.level == "failure" else "left"
    place = {"xycoords": ("data", "axes fraction"), "rotation": 90, "va": "top", "ha": side}
    axis.annotate(mark.level, (mark.t, 0.98), color=color, fontsize=8, **place)


def _span(charts: Sequence[Chart], marks: Sequence[Mark]) -> tuple[float, float]:
    """Return where the time axis of all charts begins and ends [s]."""
    lines = [line.points[0] for chart in charts if not chart.is_path for line in chart.lines]
    times = np.concatenate([*lines, np.array([mark.t for mark in marks])])
    low, high = (float(times.min()), float(times.max())) if len(times) else (0.0, 1.0)
    # What failed ends the run, though others were some steps ahead of it.
    high = min([high, *(mark.t for mark in marks if mark.level == "failure")])
    room = 0.02 * (high - low) or 0.5
    return low - room, high + room


def _shared_names(charts: Sequence[Chart]) -> dict[str, int]:
    """Return name → style of the lines that several charts have, such as joints."""
    counted = Counter(
        (line.label, line.number) for chart in charts for line in chart.lines if line.is_solid
    )
    shared = {label: number for (label, number), count in counted.items() if count > 1}
    return shared if 1 < len(shared) <= _MOST_NAMES else {}


def _look(line: ChartLine) -> dict[str, Any]:
    """Return how matplotlib draws a line."""
    style = line_style(line.number)
    color = LINES[style.color]
    if line.is_wide:
        return {"color": color, "linewidth": 5, "alpha": 0.35}
    if line.role == "target":
        return {"color": color, "linewidth": 1.2, "linestyle": ":"}
    broken = (0, (5, 2)) if style.is_broken else "-"
    return {"color": color, "linewidth": 1.5, "linestyle": broken}


def save(title: str, charts: Sequence[Chart], target: Path, *, marks: Sequence[Mark] = ()) -> None:
    """Write charts as a picture; raises as `draw`, RecordingFailed when it cannot be written."""
    try:
        picture = draw(title, charts, target.suffix[1:] or "png", marks=marks)
    except ExtraMissing:
        raise
    except ValueError as exc:
        raise RecordingFailed(f"{target} cannot be written: {exc}") from exc
    with replaced(target) as part:
        part.write_bytes(picture)


def _draw(axis: Any, chart: Chart, *, is_named: bool) -> None:
    factor, unit = (1.0, "m") if chart.is_path else prefixed(chart.largest, chart.unit)
    used = f"   {100 * chart.used:.0f} % of limit used" if chart.used is not None else ""
    axis.set_title(chart.title + used, loc="left", fontsize=10)
    axis.set_ylabel(f"[{unit}]" if unit else "")
    axis.grid(visible=True, alpha=0.3)
    axis.margins(x=0.01)
    for line in chart.drawn:
        curve = Curve()
        curve.add(line.points[0], line.points[1][:, None])
        t, values = curve.line(0)
        axis.plot(t, factor * values, label=line.label, **_look(line))
    if chart.is_near_limit:
        for limit in chart.limits:
            axis.axhline(factor * limit, color=PAPER["bad"], linewidth=1, linestyle=(0, (5, 3)))
    solid = {line.label: axis.lines[i] for i, line in enumerate(chart.drawn) if line.is_solid}
    if (
        is_named
        and not (chart.is_path and len(solid) < 2)
        and list(solid) not in ([], [chart.title.rpartition(": ")[2]])
    ):
        columns = 1 + (len(solid) - 1) // _MOST_ROWS
        axis.legend(solid.values(), solid, frameon=False, fontsize=8, ncols=columns, loc="best")


REPORT_FILE = "report.png"
_SHOWN = ("BaseState/1", "GripperState/1", "Imu/1", "Scalars/1", "Wrench/1")
_MOST_FIELDS = _MOST_LINES = 8


def draw_report(
    recording: Recording,
    joints: JointCurves,
    ports: Sequence[PortCurves],
    marks: Sequence[Mark] = (),
    result: Result | None = None,
) -> Iterator[str]:
    """Write report.png beside a recording, and yield the line of the summary about it.

    marks: what it shows of events: the serious ones. result: of the run, where there is one.
    """
    charts = [*all_joints(joints), *port_charts(ports)]
    if charts:
        target = recording.path.with_name(REPORT_FILE)
        try:
            title = scenario_name(recording)
            failed = f": failed, {result.cause}" if result and result.exit_code else ""
            more = f", {NO_DYNAMICS}{failed}" if lacks_dynamics(recording) else failed
            shown = [mark for mark in marks if mark.level in _MARKS]
            save(f"{title}{more}", charts, target, marks=shown)
        except (StepbusError, OSError) as exc:
            yield f"no plots  {exc}"
        else:
            yield f"plots     {target}"


def port_charts(ports: Sequence[PortCurves]) -> list[Chart]:
    """Return a chart for each field of bases, grippers, sensors and own types, up to eight."""
    charts: list[Chart] = []
    for port in ports:
        if is_pictured(port.port):
            path = path_of(port)
            if path is not None:
                line = ChartLine("path", path)
                charts.append(Chart(f"{port.name}: path from above", "m", [line], is_path=True))
            charts += [
                replace(field_chart(field, _MOST_LINES), title=f"{port.name}: {field.title}")
                for field in port.fields.values()
                if path is None or field.title not in {"x", "y"}
            ]
    return charts[:_MOST_FIELDS]


def is_pictured(port: Port) -> bool:
    """Return whether report.png has the numbers of a port that is no joint's."""
    return port.type in _SHOWN or port.type not in SHIPPED
