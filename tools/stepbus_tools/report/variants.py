"""One picture of a recording and its branches."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from stepbus_orchestrator.analysis.signals import read_tracking
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import WiringError
from stepbus_tools.report.charts import Chart, ChartLine, Role, find_signals
from stepbus_tools.report.picture import save

_MOST_VARIANTS = 4
_BEFORE = 0.1
"""How much of the time behind the branch is shown before it."""
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
    panels: dict[str, list[ChartLine]] = {}
    units: dict[str, str] = {}
    mark_s = 0.0
    for name, path in {_RECORDED: recording, **branches}.items():
        with Recording(path) as opened:
            mark_s = mark_s or at * _step_s(opened)
            chosen = [chart for text in signals for chart in find_signals(opened, text)]
            for chart in chosen if signals else _errors(opened):
                for line in chart.lines:
                    role: Role = "reference" if name == _RECORDED else "measured"
                    title = f"{chart.title}: {line.label}".removesuffix(f": {chart.title}")
                    panels.setdefault(title, []).append(replace(line, label=name, role=role))
                    units[title] = chart.unit
    if not panels:
        raise WiringError(
            f"{recording} has no joint to draw; choose signals with --plot, e.g. of "
            f"`stepbus plot {recording}`"
        )
    charts = [_around(mark_s, title, units[title], lines) for title, lines in panels.items()]
    save(str(recording), charts, target, mark_s=mark_s)
    return list(panels)


def _step_s(recording: Recording) -> float:
    """Return how long a step is [s]."""
    ports = (port for port in recording.ports.values() if port.last_step > 0)
    return next((float(port.t[-1] / port.steps[-1]) for port in ports), 0.0)


def _around(mark_s: float, title: str, unit: str, lines: Sequence[ChartLine]) -> Chart:
    """Return lines from a little before a time on; those of the recording behind the others."""
    end_s = max((float(line.t[-1]) for line in lines if len(line.t)), default=mark_s)
    start_s = max(0.0, mark_s - _BEFORE * (end_s - mark_s))
    cut = [
        replace(line, t=line.t[line.t >= start_s], values=line.values[line.t >= start_s])
        for line in sorted(lines, key=lambda line: line.role == "reference")
    ]
    return Chart(title=title, unit=unit, lines=cut)


def _errors(recording: Recording) -> Iterator[Chart]:
    """Yield the error of each joint with a reference, or the position of each that is measured."""
    tracking = read_tracking(recording)
    what = "error" if tracking.joints else "position"
    for joint in (tracking.joints or tracking.measured)[:_MOST_VARIANTS]:
        state = tracking.state_of(joint)
        if state is None:
            continue
        values = tracking.error(joint) if tracking.joints else state.of("position", joint)
        if values is not None:
            title = f"{joint}: {what}"
            line = ChartLine(label=title, t=state.t, values=values)
            yield Chart(title=title, unit=tracking.unit(joint), lines=[line])
