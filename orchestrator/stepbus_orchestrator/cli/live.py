"""What a run looks like while it goes on: a live table, or plain lines without a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.live import Live
from rich.table import Table

from ..progress import Progress
from .keys import HELP

_PLAIN_EVERY_S = 2.0


class LiveTable:
    """Shows progress as a table that updates itself, at the pace it is told."""

    def __init__(self, title: str, console: Console) -> None:
        self._title = title
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._live.start()
        self._console = console

    def progress(self, progress: Progress) -> None:
        """Draw the table anew."""
        self._live.update(_table(self._title, progress), refresh=True)

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Print a sentence above the table."""
        self._console.print(f"{level}: {who} at step {step}: {text}", markup=False, soft_wrap=True)

    def close(self) -> None:
        """Take the table away."""
        self._live.stop()


class PlainLines:
    """Shows progress as a line every two seconds."""

    def __init__(self, title: str, console: Console) -> None:
        self._title = title
        self._console = console
        self._shown_s = -_PLAIN_EVERY_S

    def progress(self, progress: Progress) -> None:
        """Print a line, when the last one is old enough."""
        if progress.elapsed_s - self._shown_s >= _PLAIN_EVERY_S:
            self._shown_s = progress.elapsed_s
            self._console.print(
                f"{self._title}: {_headline(progress)}", markup=False, soft_wrap=True
            )

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Print a sentence."""
        self._console.print(f"{level}: {who} at step {step}: {text}", markup=False, soft_wrap=True)

    def close(self) -> None:
        """Nothing is left to do."""


def make_display(title: str, *, plain: bool = False) -> LiveTable | PlainLines:
    """Return the display that fits where stdout goes; plain: others print there too."""
    console = Console()
    if plain or not console.is_terminal:
        return PlainLines(title, console)
    return LiveTable(title, console)


def _headline(progress: Progress) -> str:
    if progress.phase == "starting":
        late = [name for name, phase in progress.phases.items() if phase != "ready"]
        return f"starting, waiting for {', '.join(late)}"
    simulated_s = progress.step * progress.step_ns * 1e-9
    total = "" if progress.steps is None else f" of {progress.steps}"
    if progress.phase == "paused":
        return f"paused before step {progress.step}{total}, t = {simulated_s:.3f} s"
    factor = simulated_s / progress.elapsed_s if progress.elapsed_s else 0.0
    return f"step {progress.step}{total}, t = {simulated_s:.2f} s, {factor:.1f} × real time"


def _table(title: str, progress: Progress) -> Table:
    table = Table(
        title=f"{title}: {_headline(progress)}",
        title_justify="left",
        caption=HELP,
        caption_justify="left",
    )
    for column in ("participant", "state", "µs per step", "dropped"):
        table.add_column(column, justify="left" if column in {"participant", "state"} else "right")
    for name, phase in progress.phases.items():
        state = "holds the step" if name in progress.holders else phase
        compute = progress.compute_us.get(name)
        table.add_row(
            name,
            state,
            "" if compute is None else f"{compute:.0f}",
            str(progress.drops.get(name, 0)),
        )
    return table
