"""How far a command is: one bar in a terminal, by Rich, or a few calm lines elsewhere."""

import contextlib
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import IO

from stepbus_orchestrator.cli.terminal.keys import HELP
from stepbus_orchestrator.cli.terminal.output import INDENT, fold, has_screen, visible, write
from stepbus_orchestrator.run.reports import Observer, Progress

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

    title: what it does. what: where it is, e.g. `step 840 of 2000`. done, total: how much, in any
    unit; a total of None has no end. rate: how fast, in words. left_s: time left [s]; None: not
    known. is_paused: nothing moves until the user lets it. note: what else is worth a line.
    """

    title: str
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

    def line(self) -> str:
        """Return all of it in one line."""
        note = f"; {self.note}" if self.note else ""
        return f"{self.title}: {', '.join([self.what, *self.figures()])}{note}"


class Lines:
    """Prints lines: of progress after 2, 10 and 50 s, then each minute, and at the ends of a pause.

    clock: seconds of the wall clock.
    """

    def __init__(self, stream: IO[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._began_s = clock()
        self._due_s = _FIRST_LINE_S
        self._is_paused = False

    def say(self, text: str) -> None:
        """Print a line."""
        write(self._stream, f"{text}\n")

    def show(self, reached: Reached) -> None:
        """Print how far the command is, if it is time to."""
        passed_s = self._clock() - self._began_s
        is_due = passed_s >= self._due_s
        if is_due:
            self._due_s = min(5 * passed_s, passed_s + _LINES_EVERY_S)
        if reached.is_paused != self._is_paused or (is_due and not reached.is_paused):
            self._is_paused = reached.is_paused
            self.say(reached.line())

    def close(self) -> None:
        """Do nothing: lines stay."""


class Bar:
    """Draws one bar, again with each report; lines that are printed meanwhile stand above it.

    below: lines that always stand below its figures.
    """

    def __init__(self, stream: IO[str], below: Sequence[str] = ()) -> None:
        # In a pipe, nothing of a run has to load it.
        from rich import console, progress, table  # noqa: PLC0415

        self._below = below
        self._progress = progress.Progress(
            progress.TextColumn("{task.description}", "bold", markup=False),
            progress.BarColumn(_BAR_COLUMNS, complete_style="cyan", finished_style="cyan"),
            progress.TextColumn("{task.fields[text]}", markup=False, table_column=table.Column()),
            console=console.Console(file=stream),
            auto_refresh=False,
            transient=True,
        )
        self._task = self._progress.add_task("", total=None, text="")

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        screen = self._progress.console
        screen.print(fold(visible(text), screen.width, INDENT), markup=False, soft_wrap=True)

    def show(self, reached: Reached) -> None:
        """Draw how far the command is."""
        lines = ("  ".join(reached.figures()), reached.what, reached.note, *self._below)
        self._progress.update(
            self._task,
            description=reached.title,
            total=reached.total,
            completed=reached.done,
            text="\n".join(filter(None, lines)),
        )
        self._progress.start()
        self._progress.refresh()

    def close(self) -> None:
        """Remove the bar."""
        self._progress.stop()


def open_screen(stream: IO[str], below: Sequence[str] = ()) -> Lines | Bar:
    """Return the bar of a terminal that can draw it, lines elsewhere. below: lines below the bar.

    Either has `say`, which prints a line, `show`, which shows progress, and `close`.
    """
    return Bar(stream, below) if has_screen(stream) else Lines(stream)


class Display(Observer):
    """Shows on a screen how far a run is, and how fast it is now, and what it reports.

    degrees: with the angles of all joints. runs: how many there are, one after the other.
    has_progress: otherwise it shows sentences only.
    """

    def __init__(
        self,
        screen: Lines | Bar,
        title: str,
        *,
        degrees: bool = False,
        runs: int = 1,
        has_progress: bool = True,
    ) -> None:
        self._screen = screen
        self._title = title
        self._degrees = degrees
        self._runs = runs
        self._has_progress = has_progress
        self._run = 1
        self._newest: deque[Progress] = deque(maxlen=_REPORTS)
        self.say = screen.say
        """Show a line, above the bar if there is one."""

    def progress(self, progress: Progress) -> None:
        """Show the progress of the run."""
        if self._has_progress:
            self._screen.show(self.reached(progress))

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show a sentence, above the bar if there is one."""
        where = who if step < 0 else f"{who} at step {step}"
        self.say(f"{level}: {where}: {text}")

    def next_run(self) -> None:
        """Take the progress of the next run from now on."""
        self._run += 1
        self._newest.clear()

    def reached(self, progress: Progress) -> Reached:
        """Return how far the run is, by its newest report."""
        rate = self._rate(progress)
        steps = progress.steps or 0
        done, total = (self._run - 1) * steps + progress.step, self._runs * steps
        factor = rate * progress.step_ns * 1e-9
        return Reached(
            title=self._title,
            what=_what(progress) + f", run {self._run} of {self._runs}" * (self._runs > 1),
            done=done,
            total=total or None,
            rate=f"{factor:{'.1f' if factor >= 1 else '.2g'}} × real time" if rate else "",
            left_s=(total - done) / rate if rate and total else None,
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


@contextlib.contextmanager
def displayed(
    title: str,
    *,
    quiet: bool,
    plain: bool = False,
    degrees: bool = False,
    invites: bool = False,
    keys: bool = False,
    runs: int = 1,
) -> Iterator[Display | None]:
    """Yield the display for where stdout goes.

    plain: a debugger has it. quiet: there is none. degrees: it shows the angles of all joints.
    invites: even so, sentences go to stderr: the user has to read what the run waits for. keys:
    it shows which keys control the run. runs: how many there are; `next_run` tells them apart.
    """
    if quiet and not invites:
        yield None
        return
    is_plain = plain or quiet
    # The stream itself: a run in one process replaces `sys.stdout` during a participant's turn.
    stream = sys.stderr if quiet else sys.stdout
    screen = Lines(stream) if is_plain else open_screen(stream, (HELP,) if keys else ())
    with contextlib.closing(screen):
        yield Display(screen, title, degrees=degrees, runs=runs, has_progress=not is_plain)


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
