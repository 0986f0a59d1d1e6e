"""One picture of a recording and its branches."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import WiringError
from stepbus_tools.report.charts import Chart, ChartLine, Mark, Role, find_signals, joint_charts
from stepbus_tools.report.picture import save
from stepbus_tools.report.summary import read_joints

_MOST_VARIANTS = 4
_BEFORE = 0.1
"""How much of the time after the branch is shown before it."""
_RECORDED = "recorded"


def draw_variants(
    recording: Path,
    branches: Mapping[str, Path],
    target: Path,
    *,
    at: int,
    signals: Sequence[str] = (),
) -> list[str]:
    """Draw signals of a recording and of its branches over each other, one panel each.

    branches: name → recording. at: the step where they begin; it is marked. signals: as of `stepbus
    plot`; default: the error of the first joints, or their positions. Returns the signals drawn.

    Raises WiringError for a signal that the recording lacks, ExtraMissing without matplotlib.
    """
    panels: dict[tuple[str, str], list[ChartLine]] = {}
    mark_s = 0.0
    for name, path in {_RECORDED: recording, **branches}.items():
        role: Role = "reference" if name == _RECORDED else "measured"
        number = list(branches).index(name) + 1 if name in branches else 0
        with Recording(path) as opened:
            if name == _RECORDED:
                rows = (port.last for port in opened.ports.values())
                mark_s = at * next((r.t_ns * 1e-9 / r.step for r in rows if r and r.step > 0), 0.0)
            chosen = [chart for text in signals for chart in find_signals(opened, text)]
            for chart in chosen if signals else _errors(opened):
                for line in chart.lines:
                    title = f"{chart.title}: {line.label}".removesuffix(f": {chart.title}")
                    lines = panels.setdefault((title, chart.unit), [])
                    lines.append(ChartLine(name, line.points, role, number))
    if not panels:
        raise WiringError(
            f"{recording} has no joints to plot; choose signals with --plot; `stepbus "
            f"plot {recording}` lists them"
        )
    charts = [Chart(*key, _around(mark_s, lines)) for key, lines in panels.items()]
    save(str(recording), charts, target, marks=[Mark(t=mark_s)])
    return [chart.title for chart in charts]


def _around(mark_s: float, lines: Sequence[ChartLine]) -> list[ChartLine]:
    """Return lines from a little before a time on; those of the recording after the others."""
    end_s = max((float(line.points[0][-1]) for line in lines), default=mark_s)
    start_s = max(0.0, mark_s - _BEFORE * (end_s - mark_s))
    cut = []
    for line in sorted(lines, key=lambda line: line.role == "reference"):
        t, values = line.points
        cut.append(replace(line, points=(t[t >= start_s], values[t >= start_s])))
    return cut


def _errors(recording: Recording) -> Iterator[Chart]:
    """Yield the error of each joint with a reference, or the position of each that is measured."""
    curves, _ = read_joints(recording)
    for joint in (curves.joints or curves.measured)[:_MOST_VARIANTS]:
        error, position, *_ = joint_charts(curves, joint)
        chart = error if curves.joints else position
        title = f"{joint}: {chart.title}"
        lines = [replace(line, label=title) for line in chart.lines if line.is_solid]
        yield replace(chart, title=title, lines=lines)
