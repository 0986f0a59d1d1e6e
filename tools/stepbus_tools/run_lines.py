"""The report of a run, and the lines of its summary."""

from pathlib import Path

from stepbus_schemas import StepbusError
from stepbus_tools.report import draw_report, write_report
from stepbus_tools.viewing.page import PAGE_FILE, RunPage, render_page


def run_lines(recording: Path, *, has_plots: bool) -> list[str]:
    """Return the lines of `after_run`, whose report it writes."""
    if not has_plots:
        return write_report(recording, has_plots=False)
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
