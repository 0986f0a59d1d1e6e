"""How far a command is: one bar in a terminal, by Rich, or a few calm lines elsewhere."""

import contextlib
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import IO, TYPE_CHECKING

from stepbus_orchestrator.cli.terminal.keys import HELP
from stepbus_orchestrator.cli.terminal.output import INDENT, fold, has_screen, visible, write
from stepbus_orchestrator.run.reports import Observer, Progress

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

_FIRST_LINE_S = 2.0
_LINES_EVERY_S = 60.0
_BAR_COLUMNS = 30
_REPORTS = 40
"""How many reports, of about four a second, count for the rate."""
_LEAST_RATE = 0.01
"""What is slower stands still [steps/s]."""


@dataclass(frozen=True, kw_only=True)
class Reached:
    """How far a command is.

    what: where it is, e.g. `step 840 of 2000`. done, total: how much, in any unit; a total of None
    has no end. rate: how fast, in words. left_s: time left [s]; None: not known. is_paused: nothing
    moves until the user lets it. note: what else is worth a line.
    """

    what: str
    done: float = 0.0
    total: float | None = None
    rate: str = ""
    left_s: float | None = None
    is_paused: bool = False
    note: str = ""

    def figures(self) -> list[str]:
        """Return the share that is done, the rate and the time left, as far as they are known."""
        # It is 100 % at the end only.
        share = f"{math.floor(100 * self.done / self.total)} %" if self.total else ""
        seconds = round(self.left_s or 0.0)
        left = f"{timedelta(seconds=seconds)} left" if seconds else ""
        return [figure for figure in (share, self.rate, left) if figure]


class Display(Observer):
    """Shows how far a command is: a bar that is drawn again in a terminal, elsewhere lines.

    Lines come after 2, 10 and 50 s, then each minute, and at the ends of a pause.

    title: of the command. degrees: with the angles of all joints. is_plain: no progress of a run,
    and no bar. below: a line that always stands below the bar. clock: seconds of the wall clock.
    """

    def __init__(
        self,
        stream: IO[str],
        title: str,
        *,
        degrees: bool = False,
        is_plain: bool = False,
        below: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stream = stream
        self._title = title
        self._degrees = degrees
        self._is_plain = is_plain
        self._below = below
        self._clock = clock
        self._bar = _bar(stream, title) if has_screen(stream) and not is_plain else None
        self._began_s = clock()
        self._due_s = _FIRST_LINE_S
        self._is_paused = False
        self._newest: deque[Progress] = deque(maxlen=_REPORTS)

    def say(self, text: str) -> None:
        """Print a line, above the bar if there is one."""
        if self._bar is None:
            write(self._stream, f"{text}\n")
        else:
            screen = self._bar.console
            screen.print(fold(visible(text), screen.width, INDENT), markup=False, soft_wrap=True)

    def show(self, reached: Reached) -> None:
        """Show how far the command is; as a line, if it is time for one."""
        if self._bar is not None:
            lines = ("  ".join(reached.figures()), reached.what, reached.note, self._below)
            text = "\n".join(filter(None, lines))
            (task,) = self._bar.task_ids
            self._bar.update(task, total=reached.total, completed=reached.done, text=text)
            self._bar.start()
            self._bar.refresh()
            return
        passed_s = self._clock() - self._began_s
        is_due = passed_s >= self._due_s
        if is_due:
            self._due_s = min(5 * passed_s, passed_s + _LINES_EVERY_S)
        if reached.is_paused != self._is_paused or (is_due and not reached.is_paused):
            self._is_paused = reached.is_paused
            note = f"; {reached.note}" if reached.note else ""
            self.say(f"{self._title}: {', '.join([reached.what, *reached.figures()])}{note}")

    def close(self) -> None:
        """Remove the bar; lines stay."""
        if self._bar is not None:
            self._bar.stop()

    def progress(self, progress: Progress) -> None:
        """Show the progress of a run."""
        if not self._is_plain:
            self.show(self.reached(progress))

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show an event of a run."""
        where = who if step < 0 else f"{who} at step {step}"
        self.say(f"{level}: {where}: {text}")

    def reached(self, progress: Progress) -> Reached:
        """Return how far a run is, by its newest report."""
        rate = self._rate(progress)
        left = (progress.steps or 0) - progress.step
        factor = rate * progress.step_ns * 1e-9
        return Reached(
            what=_what(progress),
            done=progress.step,
            total=progress.steps,
            rate=f"{factor:{'.1f' if factor >= 1 else '.2g'}} × real time" if rate else "",
            left_s=left / rate if rate and progress.steps else None,
            is_paused=progress.phase == "paused",
            note=_note(progress, degrees=self._degrees),
        )

    def _rate(self, progress: Progress) -> float:
        """Return the rate of the last ten seconds [steps/s]; 0 while the run does not move."""
        if progress.phase != "stepping":
            self._newest.clear()
            return 0.0
        self._newest.append(progress)
        first = self._newest[0]
        passed_s = progress.elapsed_s - first.elapsed_s
        rate = (progress.step - first.step) / passed_s if passed_s > 0 else 0.0
        return rate if rate > _LEAST_RATE else 0.0


def _bar(stream: IO[str], title: str) -> "Bar":
    # In a pipe, nothing of a run has to load it.
    from rich import console, progress, table  # noqa: PLC0415

    bar = progress.Progress(
        progress.TextColumn("{task.description}", "bold", markup=False),
        progress.BarColumn(_BAR_COLUMNS, complete_style="cyan", finished_style="cyan"),
        progress.TextColumn("{task.fields[text]}", markup=False, table_column=table.Column()),
        console=console.Console(file=stream),
        auto_refresh=False,
        transient=True,
    )
    bar.add_task(title, total=None, text="")
    return bar


@contextlib.contextmanager
def displayed(
    title: str,
    *,
    quiet: bool,
    plain: bool = False,
    degrees: bool = False,
    invites: bool = False,
    keys: bool = False,
) -> Iterator[Display | None]:
    """Yield the display for where stdout goes.

    plain: a debugger has it. quiet: there is none. degrees: it shows the angles of all joints.
    invites: even so, sentences go to stderr: the user has to read what the run waits for. keys:
    it shows which keys control the run.
    """
    if quiet and not invites:
        yield None
        return
    # The stream itself: a run in one process replaces `sys.stdout` during a participant's turn.
    stream = sys.stderr if quiet else sys.stdout
    below = HELP if keys else ""
    display = Display(stream, title, degrees=degrees, is_plain=plain or quiet, below=below)
    with contextlib.closing(display):
        yield display


def _note(progress: Progress, *, degrees: bool) -> str:
    """Return the angles of all joints if asked for, the slowest participant, and drops."""
    facts = [in_degrees(progress)] if degrees else []
    if progress.compute_us:
        slowest = max(progress.compute_us, key=lambda name: progress.compute_us[name])
        facts.append(f"slowest: {slowest}, {progress.compute_us[slowest]:.0f} µs a step")
    if dropped := [f"{count} by {name}" for name, count in progress.drops.items() if count]:
        facts.append(f"dropped: {', '.join(dropped)}")
    return "; ".join(facts)


def in_degrees(progress: Progress) -> str:
    """Return the measured angle of each joint [°]."""
    angles = progress.angles.items()
    return ", ".join(f"{name} {math.degrees(angle):.1f}°" for name, angle in angles)


def _what(progress: Progress) -> str:
    if progress.phase == "starting":
        late = [name for name, phase in progress.phases.items() if phase != "ready"]
        return f"starting, waiting for {', '.join(late)}"
    simulated_s = progress.step * progress.step_ns * 1e-9
    total = "" if progress.steps is None else f" of {progress.steps}"
    if progress.phase == "paused":
        return f"paused before step {progress.step}{total}, t = {simulated_s:.3f} s"
    return f"step {progress.step}{total}, t = {simulated_s:.2f} s"
