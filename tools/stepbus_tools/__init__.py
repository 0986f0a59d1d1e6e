"""Tools over recordings and around runs: views, reports, exports, sweeps, checks.

They use the core, which does not know them: it finds them by entry points. Users import the same
from `stepbus`.
"""

from pathlib import Path


def after_run(recording: Path, *, has_plots: bool) -> list[str]:
    """Write report.html and report.png; return what the summary of a run says of its recording.

    has_plots: without it, nothing is written, and the lines have the figures alone.
    """
    # What users import from here must not load all tools.
    from stepbus_tools.report import write_report  # noqa: PLC0415

    lines = write_report(recording, has_plots=has_plots)
    if not has_plots:
        return lines
    from stepbus_tools.viewing.page import page_line  # noqa: PLC0415

    return [*lines, page_line(recording, lines)]
