"""The plots of a run, beside its recording: report.png."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.findings import findings
from stepbus_orchestrator.analysis.replaced import replaced
from stepbus_orchestrator.analysis.signals import tracking_pieces
from stepbus_orchestrator.recording import Recording, layout
from stepbus_participant import extra_hint
from stepbus_schemas import StepbusError

from .curves.pose_errors import draw_pose_errors, pose_errors
from .curves.tracking import TrackingCurves
from .lateness import lateness_panels, read_lateness
from .panels.devices import Panel, device_panels
from .panels.fields import field_panels
from .panels.joints import draw_panels, panel_rows
from .panels.tracking import draw_tracking
from .profile import profile_lines, profile_panels, read_profiles
from .signals_plot import drawn
from .summary import Summary

REPORT_FILE = "report.png"
# More joints than that share no plot.
_MOST_LINES = 6

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
            found = [*findings(recording), *([late] if late else [])]
            problems = [f"attention {line}" for line in found]
            if tracking.measured:
                lines = summary.lines()
            profiles = read_profiles(path.parent)
            lines = [*lines, *problems, *profile_lines(profiles)]
            if _lacks_dynamics(recording):
                lines.append(f"dynamics  off: {_NO_DYNAMICS}")
            if not has_plots:
                return lines
            target = path.with_name(REPORT_FILE)
            panels = [*device_panels(recording), *field_panels(recording)]
            panels += profile_panels(profiles)
            panels += lateness_panels(lateness)
            if not tracking.measured and not panels:
                return lines
            errors = pose_errors(recording)
            more = [partial(draw_pose_errors, errors=errors)] if errors else []
            draw_report(_title(recording), tracking, panels, target, more)
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


def draw_report(
    title: str,
    tracking: TrackingCurves,
    devices: Sequence[Panel],
    target: Path,
    more: Sequence[Panel] = (),
) -> None:
    """Write the figure: joints to the left, devices and fields to the right, as far as there are.

    more: panels beside those of the joints, where each has its own.

    Raises ImportError without matplotlib, RecordingFailed when it cannot be written.
    """
    # Loading matplotlib takes longer than to start a run, and it is an extra.
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    has_joints = bool(tracking.measured)
    width = 30 if devices and has_joints else 18
    has_panels = len(tracking.measured) > _MOST_LINES
    height = max(10.0, 2.5 * panel_rows(tracking)) if has_panels else 10.0
    figure = Figure(figsize=(width, height), dpi=100 if not devices else 75, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=16)
    joints: Any = figure
    if devices and has_joints:
        halves: Any = figure.subfigures(1, 2)
        joints = halves[0]
        _draw_devices(halves[1], devices)
    elif devices:
        _draw_devices(figure, devices)
    if has_panels:
        draw_panels(joints, tracking, more)
    elif has_joints:
        draw_tracking(joints, tracking)
    with replaced(target) as part:
        part.write_bytes(drawn(figure, "png"))


def _draw_devices(figure: Any, panels: Sequence[Panel]) -> None:
    """Plot what there is beside joints."""
    rows = max(2, -(-len(panels) // 2))
    axes = figure.subplots(rows, 2, squeeze=False).flatten()
    for axis, panel in zip(axes, panels, strict=False):
        panel(axis)
        axis.grid(visible=True, alpha=0.3)
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
