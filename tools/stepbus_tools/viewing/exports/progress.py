"""A progress bar on the terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Reached = Callable[[int], None]
"""Takes the step that was reached."""


@contextmanager
def progress_bar(what: str, last_step: int) -> Iterator[Reached]:
    """Show how far an export has come, where the standard error is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _step: None
        return
    # It takes a tenth of a second to load.
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    console = Console(stderr=True)
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as bar:
        task = bar.add_task(what, total=max(1, last_step))
        yield lambda step: bar.update(task, completed=step)
