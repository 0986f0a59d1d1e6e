"""How far a command is: one bar in a terminal, or a few calm lines elsewhere.

Everything that takes its time shows it by these: runs by `live.Display`, sweeps by themselves.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

_LINES_S = (2.0, 10.0)
_LINES_EVERY_S = 60.0
_WINDOW_S = 10.0
_LEAST_S = 0.5
"""What a rate is measured over [s]: the newest, and at least."""
_BAR_COLUMNS = 30
_MINUTE_S, _HOUR_S = 90.0, 90 * 60.0
"""From where on a time is said in minutes, or in hours [s]."""


@dataclass(frozen=True, kw_only=True)
class Reached:
    """How far a command is.

    title: what it does. what: where it is, e.g. `step 840 of 2000`. done, total: how much, in any
    unit; a total of None has no end. rate: how fast, in words. left_s: time left [s]; None: not
    known. is_paused: nothing moves until the user lets it. note: what else is worth a line. detail:
    the same, below the bar only.
    """

    title: str
    what: str
    done: float = 0.0
    total: float | None = None
    rate: str = ""
    left_s: float | None = None
    is_paused: bool = False
    note: str = ""
    detail: str = ""

    @property
    def share(self) -> str:
        """Return the share that is done, e.g. `42 %`; it is 100 % at the end only."""
        return f"{math.floor(100 * self.done / self.total)} %" if self.total else ""

    @property
    def left(self) -> str:
        """Return the time left in words, where it is known and at least a second."""
        if self.left_s is None or self.left_s < 1.0 or self.is_paused:
            return ""
        return f"{span(self.left_s)} left"

    def line(self) -> str:
        """Return all of it in one line."""
        parts = (self.what, self.share, self.rate, self.left)
        note = f"; {self.note}" if self.note else ""
        return f"{self.title}: {', '.join(filter(None, parts))}{note}"


def span(seconds: float) -> str:
    """Return a time span in words, such as `12 s`, `3 min` or `2 h 05 min`."""
    if seconds < _MINUTE_S:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if seconds < _HOUR_S else f"{minutes // 60} h {minutes % 60:02} min"


class Rate:
    """How fast something moves, measured over the last ten seconds in which it could."""

    def __init__(self) -> None:
        self._marks: deque[tuple[float, float]] = deque()
        self._moved_s = 0.0
        self._last_s: float | None = None

    def take(self, now_s: float, done: float, *, is_moving: bool) -> float | None:
        """Take how much is done at a time [s]; return the rate [1/s], None where none is known."""
        if is_moving and self._last_s is not None:
            # The clock of a run begins anew with its first step.
            self._moved_s += max(0.0, now_s - self._last_s)
        self._last_s = now_s if is_moving else None
        if is_moving:
            self._marks.append((self._moved_s, done))
        while len(self._marks) > 2 and self._marks[1][0] <= self._moved_s - _WINDOW_S:
            self._marks.popleft()
        if not self._marks:
            return None
        first_s, first = self._marks[0]
        passed_s = self._moved_s - first_s
        return (self._marks[-1][1] - first) / passed_s if passed_s >= _LEAST_S else None


class CalmLines:
    """Prints a line after 2 s and 10 s, then one a minute, and one where a pause begins or ends.

    write: prints it. clock: seconds of the wall clock.
    """

    def __init__(
        self, write: Callable[[str], object], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._write = write
        self._clock = clock
        self._began_s = clock()
        self._due_s = _LINES_S[0]
        self._is_paused = False

    def show(self, reached: Reached) -> None:
        """Print how far the command is, if it is time to."""
        passed_s = self._clock() - self._began_s
        is_due = passed_s >= self._due_s
        if is_due:
            later = [at for at in _LINES_S if at > passed_s]
            self._due_s = later[0] if later else passed_s + _LINES_EVERY_S
        if reached.is_paused != self._is_paused or (is_due and not reached.is_paused):
            self._is_paused = reached.is_paused
            self._write(reached.line())


def bar(reached: Reached, width: int, below: tuple[str, ...] = ()) -> RenderableType:
    """Return the bar, and the lines below it. width: of the terminal."""
    from rich.console import Group  # noqa: PLC0415  (there is nothing to draw in a pipe)
    from rich.progress_bar import ProgressBar  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    figures = "  ".join(filter(None, (reached.share, reached.rate, reached.left)))
    state = figures or reached.what
    room = width - len(reached.title) - len(state) - 3
    row: list[RenderableType] = [Text(reached.title, style="bold")]
    if reached.total and room > 0:
        drawn = ProgressBar(
            total=reached.total,
            completed=reached.done,
            width=min(_BAR_COLUMNS, room),
            complete_style="cyan",
            finished_style="cyan",
        )
        row.append(drawn)
    grid = Table.grid(padding=(0, 1))
    grid.add_row(*row, Text(state, no_wrap=room > 0))
    lines = [reached.what if figures else "", reached.detail, reached.note, *below]
    return Group(grid, *(Text(line, style="dim") for line in lines if line))


class Bar:
    """Draws one bar, again with each report; lines that are printed meanwhile stand above it.

    below: lines that always stand below it.
    """

    def __init__(self, console: Console, below: tuple[str, ...] = ()) -> None:
        from rich.live import Live  # noqa: PLC0415  (see `bar`)

        self._console = console
        self._below = below
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._live.start()

    def show(self, reached: Reached) -> None:
        """Draw how far the command is."""
        self._live.update(bar(reached, self._console.width, self._below), refresh=True)

    def close(self) -> None:
        """Remove the bar."""
        self._live.stop()
