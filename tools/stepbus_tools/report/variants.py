"""One picture of a recording and its branches."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from stepbus_orchestrator.analysis.signals import read_tracking
from stepbus_orchestrator.recording import Recording
from stepbus_participant import ExtraMissing, extra_hint
from stepbus_schemas import WiringError
from stepbus_tools.report.signals_plot import Panel, draw_signals, find_signals

_MOST_PANELS = 4
_BEFORE = 0.1
"""How much of the time behind the branch is shown before it."""
RECORDED = "recorded"


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
    opened = {RECORDED: Recording(recording)}
    opened |= {name: Recording(path) for name, path in branches.items()}
    chosen = _chosen(opened, signals) if signals else _errors(opened)
    if not chosen:
        raise WiringError(
            f"{recording} has no joint to draw; choose signals with --plot, e.g. of "
            f"`stepbus plot {recording}`"
        )
    step_s = _step_s(opened[RECORDED])
    try:
        shown = [_shown(panel, at * step_s) for panel in chosen]
        draw_signals(str(recording), shown, target, mark_s=at * step_s)
    except ImportError as exc:
        raise ExtraMissing(f"plots need {exc.name}{extra_hint(exc.name or '')}") from exc
    return [panel.title for panel in chosen]


def _shown(panel: Panel, mark_s: float) -> Panel:
    """Return a panel from a little before a time on; what was recorded is dashed."""
    end_s = max((float(t[-1]) for t, _ in panel.lines.values() if len(t)), default=mark_s)
    start_s = max(0.0, mark_s - _BEFORE * (end_s - mark_s))
    rows = {
        name: (t[t >= start_s], values[t >= start_s]) for name, (t, values) in panel.lines.items()
    }
    dashed = {RECORDED: rows.pop(RECORDED)} if RECORDED in rows else {}
    return replace(panel, lines=rows, dashed=dashed)


def _step_s(recording: Recording) -> float:
    """Return how long a step is [s]."""
    ports = (port for port in recording.ports.values() if port.last_step > 0)
    return next((float(port.t[-1] / port.steps[-1]) for port in ports), 0.0)


def _chosen(recordings: Mapping[str, Recording], signals: Sequence[str]) -> list[Panel]:
    panels: dict[str, Panel] = {}
    for name, recording in recordings.items():
        for text in signals:
            for signal in find_signals(recording, text):
                for label, row in signal.lines.items():
                    title = signal.title if label == signal.title else f"{signal.title}: {label}"
                    panel = panels.setdefault(title, Panel(title=title, unit=signal.unit))
                    panel.lines[name] = row
    return list(panels.values())


def _errors(recordings: Mapping[str, Recording]) -> list[Panel]:
    """Return the error of each joint with a reference, or the position of each that is measured."""
    panels: dict[str, Panel] = {}
    for name, recording in recordings.items():
        tracking = read_tracking(recording)
        joints = tracking.joints or tracking.measured
        for joint in joints[:_MOST_PANELS]:
            state = tracking.state_of(joint)
            if state is None:
                continue
            what = "error" if tracking.joints else "position"
            values = tracking.error(joint) if tracking.joints else state.of("position", joint)
            title = f"{joint}: {what}"
            panel = panels.setdefault(title, Panel(title=title, unit=tracking.unit(joint)))
            if values is not None:
                panel.lines[name] = state.t, values
    return list(panels.values())
