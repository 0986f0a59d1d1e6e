"""The bar of a command in a terminal, by Rich, which nothing else of a run has to load."""

from collections.abc import Iterator, Sequence
from typing import IO

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Column
from rich.text import Text

from stepbus_orchestrator.cli.terminal.output import INDENT, fold, visible
from stepbus_orchestrator.cli.terminal.progress import Reached
from stepbus_orchestrator.cli.terminal.stdout_buffer import is_held

_BAR_COLUMNS = 30


class Bar(Progress):
    """Draws one bar, again with each report; lines that are printed meanwhile stand above it.

    below: lines that always stand below it.
    """

    def __init__(self, stream: IO[str], below: Sequence[str] = ()) -> None:
        self._stream = stream
        self._below = below
        self._lines: Sequence[str] = ()
        super().__init__(
            TextColumn("{task.description}", "bold", markup=False, table_column=Column()),
            BarColumn(_BAR_COLUMNS, complete_style="cyan", finished_style="cyan"),
            TextColumn("{task.fields[figures]}", markup=False),
            console=Console(file=stream),
            auto_refresh=False,
            transient=True,
        )
        self._bar = self.add_task("", total=None, figures="")

    def get_renderables(self) -> Iterator[RenderableType]:
        """Yield the bar and the lines below it."""
        yield self.make_tasks_table(self.tasks)
        yield from (Text(line, style="dim") for line in (*self._lines, *self._below) if line)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        folded = fold(visible(text), self.console.width, INDENT)
        self.console.print(folded, markup=False, soft_wrap=True)

    def show(self, reached: Reached) -> None:
        """Draw how far the command is."""
        # What Ctrl-S holds back would be out of date when it is shown.
        if is_held(self._stream):
            return
        figures = "  ".join(reached.figures())
        self._lines = (reached.what if figures else "", reached.detail, reached.note)
        self.update(
            self._bar,
            description=reached.title,
            total=reached.total,
            completed=reached.done,
            figures=figures or reached.what,
        )
        self.start()
        self.refresh()

    def close(self) -> None:
        """Remove the bar."""
        self.stop()
