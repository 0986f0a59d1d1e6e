"""What installed packages do with the recording of a run that has ended, such as a report."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from stepbus_orchestrator.plugins import AFTER_RUN, points


@cache
def load_after_run() -> Sequence[Callable[..., list[str]]]:
    """Load what will be called, and return it."""
    return [point.load() for point in points(AFTER_RUN)]


def after_run_lines(recording: Path, *, has_plots: bool) -> list[str]:
    """Call each, and return what the summary says of the recording."""
    return [line for call in load_after_run() for line in call(recording, has_plots=has_plots)]
