"""Show the progress of a run: a live table, or plain lines without a terminal."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING

from stepbus_orchestrator.cli.keys import HELP
from stepbus_orchestrator.cli.output import visible
from stepbus_orchestrator.run.reports import Observer, Progress

# With --json, nothing is shown; else rich is imported when there is something to show.
if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

Draw = Callable[[Progress], None]

_PLAIN_EVERY_S = 2.0
_LAST_S = 10.0
"""How long the last sentences may take; where no reader takes them, the buffer gives up earlier."""


class Display(Observer):
    """Shows progress and sentences from a thread of its own.

    A terminal that is not read, or that Ctrl-S holds, blocks its writer; the run must continue.
    When there is no time, progress is left out, sentences are not. draw: shows the progress. clear:
    removes what is not to stay.
    """

    def __init__(self, console: Console, draw: Draw, clear: Callable[[], object]) -> None:
        self._console = console
        self._draw = draw
        self._clear = clear
        self._queue: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()

    def progress(self, progress: Progress) -> None:
        """Show the progress of the run if there is time for it."""
        if self._queue.empty():
            self._queue.put(partial(self._draw, progress))

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show a sentence, above a table if there is one."""
        where = who if step < 0 else f"{who} at step {step}"
        self._queue.put(partial(_print, self._console, f"{level}: {where}: {text}"))

    def close(self) -> None:
        """Show what is left if the terminal accepts it, then remove the table."""
        self._queue.put(self._clear)
        self._queue.put(None)
        self._thread.join(_LAST_S)

    def _work(self) -> None:
        while (show := self._queue.get()) is not None:  # no time-out: a daemon thread
            show()


def _print(console: Console, text: str) -> None:
    console.print(visible(text), markup=False, soft_wrap=True)


@contextlib.contextmanager
def displayed(
    title: str, *, quiet: bool, plain: bool = False, degrees: bool = False, invites: bool = False
) -> Iterator[Display | None]:
    """Yield the display for where stdout goes.

    plain: a debugger has it. quiet: there is none. degrees: it shows the angles of all joints.
    invites: even so, sentences go to stderr: the user has to read what the run waits for.
    """
    if quiet and not invites:
        yield None
        return
    from rich.console import Console  # noqa: PLC0415  see above

    # The stream itself: a run in one process replaces `sys.stdout` during a participant's turn,
    # and what this prints from its own thread would land in that participant's log.
    console = Console(file=sys.stderr if quiet else sys.stdout)
    if plain or quiet:
        display = Display(console, _do_nothing, _do_nothing)
    elif console.is_terminal:
        display = _table_display(title, console, degrees=degrees)
    else:
        display = Display(console, _draws_lines(title, console, degrees=degrees), _do_nothing)
    with contextlib.closing(display):
        yield display


def _do_nothing(*_: object) -> None: ...


def _table_display(title: str, console: Console, *, degrees: bool) -> Display:
    """Return a display that draws a table, again with each report."""
    from rich.live import Live  # noqa: PLC0415  see above

    live = Live(console=console, auto_refresh=False, transient=True)
    live.start()

    def draw(progress: Progress) -> None:
        angles = f"\n{in_degrees(progress)}" if degrees else ""
        live.update(_table(title, progress, angles), refresh=True)

    return Display(console, draw, live.stop)


def _draws_lines(title: str, console: Console, *, degrees: bool) -> Draw:
    """Return what prints a line, where the last one is two seconds old."""
    shown_s = -_PLAIN_EVERY_S

    def draw(progress: Progress) -> None:
        nonlocal shown_s
        if progress.elapsed_s - shown_s >= _PLAIN_EVERY_S:
            shown_s = progress.elapsed_s
            angles = f"; {in_degrees(progress)}" if degrees and progress.angles else ""
            _print(console, f"{title}: {_headline(progress)}{angles}")

    return draw


def in_degrees(progress: Progress) -> str:
    """Return the measured angle of each joint [°]."""
    angles = progress.angles.items()
    return ", ".join(f"{name} {math.degrees(angle):.1f}°" for name, angle in angles)


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


def _table(title: str, progress: Progress, angles: str) -> Table:
    from rich.table import Table  # noqa: PLC0415  see above

    table = Table(
        title=f"{title}: {_headline(progress)}{angles}",
        title_justify="left",
        caption=HELP,
        caption_justify="left",
    )
    for column in ("participant", "state", "µs per step", "dropped"):
        table.add_column(column, justify="left" if column in {"participant", "state"} else "right")
    for name, phase in progress.phases.items():
        state = "holds the step" if name in progress.holders else phase
        compute = progress.compute_us.get(name)
        shown = "" if compute is None else f"{compute:.0f}"
        table.add_row(name, state, shown, str(progress.drops.get(name, 0)))
    return table
