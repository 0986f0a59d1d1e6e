"""The summary of a run, and its curves in one picture beside its recording: report.png."""

from pathlib import Path

from stepbus_orchestrator.analysis.findings import findings
from stepbus_orchestrator.analysis.signals import tracking_pieces
from stepbus_orchestrator.recording import Recording, layout
from stepbus_participant import extra_hint
from stepbus_schemas import StepbusError
from stepbus_tools.report.curves import TrackingCurves
from stepbus_tools.report.panels import field_panels, joint_panels
from stepbus_tools.report.summary import Summary, profile_lines, read_lateness, read_profiles

from .signals_plot import draw_signals

REPORT_FILE = "report.png"

_NO_DYNAMICS = "joints and base follow their commands at once"


def write_report(path: Path, *, has_plots: bool = True) -> list[str]:
    """Plot a recording and return what a summary should say of it.

    path: the recording, which is read piece by piece. has_plots: whether to plot, beside it, in
    report.png. One that cannot be plotted gets a line that says why; one without anything to plot
    has no plots.
    """
    lines: list[str] = []
    try:
        with Recording(path) as recording:
            tracking, summary = TrackingCurves(), Summary()
            for piece in tracking_pieces(recording):
                tracking.take(piece)
                summary.take(piece)
            lateness = read_lateness(path.parent)
            late = lateness.complaint() if lateness is not None else ""
            notes = [*findings(recording), *([late] if late else [])]
            problems = [f"attention {line}" for line in notes]
            if tracking.measured:
                lines = summary.lines()
            lines = [*lines, *problems, *profile_lines(read_profiles(path.parent))]
            if _lacks_dynamics(recording):
                lines.append(f"dynamics  off: {_NO_DYNAMICS}")
            if not has_plots:
                return lines
            target = path.with_name(REPORT_FILE)
            panels = [*joint_panels(tracking), *field_panels(recording)]
            if not panels:
                return lines
            draw_signals(_title(recording), panels, target)
    except ImportError as exc:
        why = f"{exc.name} is not installed{extra_hint(exc.name or '')}"
        return [*lines, f"no plots  {why}"]
    except (StepbusError, OSError) as exc:
        return [f"no plots  {exc}"]
    return [*lines, f"plots     {target}"]


def _title(recording: Recording) -> str:
    text = recording.attachments.get(layout.SCENARIO_ATTACHMENT, b"").decode(errors="replace")
    names = [line.partition(":")[2] for line in text.splitlines() if line.startswith("name:")]
    title = names[0].strip() if names else recording.path.stem
    return f"{title}, {_NO_DYNAMICS}" if _lacks_dynamics(recording) else title


def _lacks_dynamics(recording: Recording) -> bool:
    """Return whether a plant of the recording moved without dynamics."""
    return any("dynamics" in port.description.details for port in recording.ports.values())
