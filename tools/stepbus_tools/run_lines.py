"""The hook after a run: writes report.html and report.png, returns lines of the summary."""

from pathlib import Path

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import StepbusError
from stepbus_tools.report.summary import read_joints


def after_run(recording: Path, *, has_plots: bool) -> list[str]:
    """Write report.html and report.png; return the lines of the summary about a recording.

    has_plots: without it, nothing is written, and the lines have the figures alone. A page that
    cannot be written changes no run.
    """
    lines: list[str] = []
    try:
        if not has_plots:
            with Recording(recording) as opened:
                return read_joints(opened)[1]
        # It loads much that figures need not.
        from stepbus_tools.viewing.page import PAGE_FILE, RunPage, render_page  # noqa: PLC0415

        run = RunPage(recording)
        lines = [*run.lines]
        # Before the picture, which takes longer: the page may be looked at already.
        page = render_page([run], run.path.with_name(PAGE_FILE))
        return [*lines, *run.draw(), f"report    {page}"]
    except (StepbusError, OSError) as exc:
        return [*lines, f"no report {exc}"]
