"""What follows a run: report.html, report.png, and lines of its summary."""

from pathlib import Path

from stepbus_schemas import StepbusError
from stepbus_tools.report import draw_report, write_report


def after_run(recording: Path, *, has_plots: bool) -> list[str]:
    """Write report.html and report.png; return what the summary of a run says of its recording.

    has_plots: without it, nothing is written, and the lines have the figures alone. A page that
    cannot be written changes no run.
    """
    if not has_plots:
        return write_report(recording, has_plots=False)
    # It loads much that figures need not.
    from stepbus_tools.viewing.page import PAGE_FILE, RunPage, render_page  # noqa: PLC0415

    lines: list[str] = []
    try:
        run = RunPage(recording)
        lines = [
            *run.lines,
            *draw_report(run.recording, run.joints, run.ports, run.marks, run.result),
        ]
        return [*lines, f"report    {render_page([run], run.path.with_name(PAGE_FILE))}"]
    except (StepbusError, OSError) as exc:
        return [*lines, f"no report {exc}"]
