"""Charts as one picture: report.png, `stepbus plot`."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_participant import ExtraMissing, need
from stepbus_schemas import SHIPPED, StepbusError
from stepbus_tools.columns import readable
from stepbus_tools.report.charts import Chart, all_joints, field_chart
from stepbus_tools.report.curves import Curve, JointCurves, PortCurves, read_ports
from stepbus_tools.report.summary import NO_DYNAMICS, lacks_dynamics, read_joints, scenario_name
from stepbus_tools.whole_file import replaced

_COLOURS = ("#1f77b4", "#d95f02", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#17becf")
_DASHED = {"color": "black", "linestyle": (0, (4, 6)), "linewidth": 1.1, "zorder": 3}
_MOST_ROWS = 12
_SOLID = ("measured", "error")


def draw(
    title: str, charts: Sequence[Chart], form: str = "png", *, mark_s: float | None = None
) -> bytes:
    """Return charts as a picture, one below the other. mark_s: a time that is marked [s].

    form: `png`, `svg`, `pdf`. Raises ValueError for another, ExtraMissing without matplotlib.
    """
    _, figures = need("a plot", "matplotlib", "matplotlib.figure")
    figure = figures.Figure(figsize=(14, 1 + 3 * len(charts)), dpi=100, layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(len(charts), 1, sharex=True, squeeze=False).flatten()
    axes[-1].set_xlabel("time [s]")
    for axis, chart in zip(axes, charts, strict=True):
        _draw(axis, chart)
        if mark_s is not None:
            axis.axvline(mark_s, color="grey", linewidth=1)
    stream = io.BytesIO()
    figure.savefig(stream, format=form)
    return stream.getvalue()


def save(title: str, charts: Sequence[Chart], target: Path, *, mark_s: float | None = None) -> None:
    """Write charts as a picture; raises as `draw`, RecordingFailed when it cannot be written."""
    try:
        picture = draw(title, charts, target.suffix[1:] or "png", mark_s=mark_s)
    except ExtraMissing:
        raise
    except ValueError as exc:
        raise RecordingFailed(f"{target} cannot be written: {exc}") from exc
    with replaced(target) as part:
        part.write_bytes(picture)


def _draw(axis: Any, chart: Chart) -> None:
    axis.set_title(chart.title, loc="left", fontsize=10)
    axis.set_ylabel(f"[{chart.unit}]" if chart.unit else "")
    axis.grid(visible=True, alpha=0.3)
    axis.margins(x=0.01)
    labels: list[str] = []
    for number, line in enumerate(chart.lines):
        curve = Curve()
        curve.add(line.points[0], line.points[1][:, None])
        solid = {"color": _COLOURS[number % len(_COLOURS)], "linewidth": 2}
        # What is dashed is black, so its legend names it once.
        label = line.label if line.label not in labels else None
        axis.plot(*curve.line(0), label=label, **(solid if line.role in _SOLID else _DASHED))
        labels.append(line.label)
    if labels and labels != [chart.title.rpartition(": ")[2]]:
        columns = 1 + (len(set(labels)) - 1) // _MOST_ROWS
        place = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
        # Beside the axis, it covers no curve.
        axis.legend(**place, frameon=False, fontsize=9, ncols=columns)


REPORT_FILE = "report.png"
_SHOWN = ("BaseState/1", "GripperState/1", "Imu/1", "Scalars/1", "Wrench/1")
_MOST_FIELDS = _MOST_LINES = 8


def write_report(path: Path, *, has_plots: bool = True) -> list[str]:
    """Plot a recording and return what a summary should say of it.

    path: the recording, which is read piece by piece. has_plots: whether to plot, beside it, in
    report.png. One that cannot be plotted gets a line that says why; one without anything to plot
    has no plots.
    """
    try:
        with Recording(path) as recording:
            joints, lines = read_joints(recording)
            if not has_plots:
                return lines
            tables = [table for table in readable(recording)[0] if is_pictured(table.port)]
            ports = [PortCurves(table, _MOST_LINES) for table in tables]
            read_ports(recording, ports)
            return [*lines, *draw_report(recording, joints, ports)]
    except (StepbusError, OSError) as exc:
        return [f"no plots  {exc}"]


def draw_report(
    recording: Recording, joints: JointCurves, ports: Sequence[PortCurves]
) -> Iterator[str]:
    """Write report.png beside a recording, and yield the line of the summary about it."""
    charts = [*all_joints(joints), *port_charts(ports)]
    if charts:
        target = recording.path.with_name(REPORT_FILE)
        try:
            title = scenario_name(recording)
            more = f", {NO_DYNAMICS}" if lacks_dynamics(recording) else ""
            save(f"{title}{more}", charts, target)
        except (StepbusError, OSError) as exc:
            yield f"no plots  {exc}"
        else:
            yield f"plots     {target}"


def port_charts(ports: Sequence[PortCurves]) -> list[Chart]:
    """Return a chart for each field of bases, grippers, sensors and own types, up to eight."""
    fields = [
        replace(field_chart(field, _MOST_LINES), title=f"{port.name}: {field.title}")
        for port in ports
        if is_pictured(port.port)
        for field in port.fields.values()
    ]
    return fields[:_MOST_FIELDS]


def is_pictured(port: Port) -> bool:
    """Return whether report.png has the numbers of a port that is no joint's."""
    return port.type in _SHOWN or port.type not in SHIPPED
