"""How far a command is: one bar in a terminal, or a few calm lines elsewhere."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING

from stepbus_orchestrator.cli.terminal.output import has_screen, write

if TYPE_CHECKING:
    from stepbus_orchestrator.cli.terminal.bar import Bar

_FIRST_LINES_S = (2.0, 10.0)
_LINES_EVERY_S = 60.0
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

    def figures(self) -> list[str]:
        """Return the share that is done, the rate and the time left, as far as they are known."""
        # It is 100 % at the end only.
        share = f"{math.floor(100 * self.done / self.total)} %" if self.total else ""
        has_left = self.left_s is not None and self.left_s >= 1.0 and not self.is_paused
        left = f"{span(self.left_s or 0.0)} left" if has_left else ""
        return [figure for figure in (share, self.rate, left) if figure]

    def line(self) -> str:
        """Return all of it in one line."""
        note = f"; {self.note}" if self.note else ""
        return f"{self.title}: {', '.join([self.what, *self.figures()])}{note}"


def span(seconds: float) -> str:
    """Return a time span in words, such as `12 s`, `3 min` or `2 h 05 min`."""
    if seconds < _MINUTE_S:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if seconds < _HOUR_S else f"{minutes // 60} h {minutes % 60:02} min"


class Lines:
    """Prints lines; of progress after 2 s and 10 s, then one a minute, and at the ends of a pause.

    clock: seconds of the wall clock.
    """

    def __init__(self, stream: IO[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._began_s = clock()
        self._due_s = _FIRST_LINES_S[0]
        self._is_paused = False

    def say(self, text: str) -> None:
        """Print a line."""
        write(self._stream, f"{text}\n")

    def show(self, reached: Reached) -> None:
        """Print how far the command is, if it is time to."""
        passed_s = self._clock() - self._began_s
        is_due = passed_s >= self._due_s
        if is_due:
            later = [at for at in _FIRST_LINES_S if at > passed_s]
            self._due_s = later[0] if later else passed_s + _LINES_EVERY_S
        if reached.is_paused != self._is_paused or (is_due and not reached.is_paused):
            self._is_paused = reached.is_paused
            self.say(reached.line())

    def close(self) -> None:
        """Do nothing: lines stay."""


def open_screen(stream: IO[str], below: tuple[str, ...] = ()) -> "Lines | Bar":
    """Return the bar of a terminal that can draw it, lines elsewhere. below: lines below the bar.

    Either has `say`, which prints a line, `show`, which shows progress, and `close`.
    """
    if not has_screen(stream):
        return Lines(stream)
    from stepbus_orchestrator.cli.terminal.bar import Bar  # noqa: PLC0415  (no Rich in a pipe)

    return Bar(stream, below)
