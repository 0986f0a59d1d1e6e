"""One picture of a recording and its branches."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from stepbus_orchestrator.analysis.report.signals_plot import Overlay, draw_overlays, find_signals
from stepbus_orchestrator.analysis.signals import read_tracking
from stepbus_orchestrator.recording import Recording
from stepbus_participant import ExtraMissing, extra_hint
from stepbus_schemas import WiringError

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
    found = _chosen(opened, signals) if signals else _errors(opened)
    if not found:
        raise WiringError(
            f"{recording} has no joint to draw; choose signals with --plot, e.g. of "
            f"`stepbus plot {recording}`"
        )
    step_s = _step_s(opened[RECORDED])
    try:
        draw_overlays(str(recording), found, target, mark_s=at * step_s, before=_BEFORE)
    except ImportError as exc:
        raise ExtraMissing(f"plots need {exc.name}{extra_hint(exc.name or '')}") from exc
    return [overlay.title for overlay in found]


def _step_s(recording: Recording) -> float:
    """Return how long a step is [s]."""
    ports = (port for port in recording.ports.values() if port.last_step > 0)
    return next((float(port.t[-1] / port.steps[-1]) for port in ports), 0.0)


def _chosen(recordings: Mapping[str, Recording], signals: Sequence[str]) -> list[Overlay]:
    overlays: dict[str, Overlay] = {}
    for name, recording in recordings.items():
        for text in signals:
            for signal in find_signals(recording, text):
                for label, values in signal.lines.items():
                    title = signal.title if label == signal.title else f"{signal.title}: {label}"
                    overlay = overlays.setdefault(title, Overlay(title=title, unit=signal.unit))
                    overlay.lines[name] = signal.t, values
    return list(overlays.values())


def _errors(recordings: Mapping[str, Recording]) -> list[Overlay]:
    """Return the error of each joint with a reference, or the position of each that is measured."""
    overlays: dict[str, Overlay] = {}
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
            overlay = overlays.setdefault(title, Overlay(title=title, unit=tracking.unit(joint)))
            if values is not None:
                overlay.lines[name] = state.t, values
    return list(overlays.values())
