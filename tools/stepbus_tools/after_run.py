"""What `stepbus run` and `stepbus branch` write beside a recording: report.html and report.png."""

from pathlib import Path

from stepbus_tools.report import write_report


def after_run(recording: Path, *, has_plots: bool) -> list[str]:
    """Write both, and return what the summary of the run says of its recording.

    has_plots: without it, nothing is written, and the lines have the figures alone.
    """
    lines = write_report(recording, has_plots=has_plots)
    if not has_plots:
        return lines
    from stepbus_tools.viewing.page import page_line  # noqa: PLC0415  (loads NumPy)

    return [*lines, page_line(recording, lines)]
