"""Tools over recordings and around runs: views, reports, exports, sweeps, checks.

They use the core, which does not know them: it finds them by entry points. Users import the same
from `stepbus`.
"""

from importlib import import_module
from pathlib import Path


def after_run(recording: Path, *, has_plots: bool) -> list[str]:
    """Write report.html and report.png; return what the summary of a run says of its recording.

    has_plots: without it, nothing is written, and the lines have the figures alone. A page that
    cannot be written changes no run.
    """
    # The help of a command of the tools loads none of them.
    writer = import_module("stepbus_tools.run_lines")
    lines: list[str] = writer.run_lines(recording, has_plots=has_plots)
    return lines
