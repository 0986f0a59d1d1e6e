"""Show the progress of a run: one bar in a terminal, a few lines elsewhere."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from queue import SimpleQueue
from typing import IO, TYPE_CHECKING

from stepbus_orchestrator.cli.terminal.keys import HELP
from stepbus_orchestrator.cli.terminal.output import INDENT, fold, has_screen, print_line, visible
from stepbus_orchestrator.cli.terminal.progress import Bar, CalmLines, Rate, Reached
from stepbus_orchestrator.run.reports import Observer, Progress

if TYPE_CHECKING:
    from rich.console import Console

_LAST_S = 10.0
"""How long the last sentences may take; where no reader takes them, the buffer gives up earlier."""


class Display(Observer):
    """Shows progress and sentences from a thread of its own.

    A terminal that is not read, or that Ctrl-S holds, blocks its writer; the run must continue.
    When there is no time, progress is left out, sentences are not. say: prints a line. show: shows
    the progress. clear: removes what is not to stay. watch: takes the reports.
    """

    def __init__(
        self,
        say: Callable[[str], object],
        show: Callable[[Reached], None],
        clear: Callable[[], object],
        watch: RunWatch,
    ) -> None:
        self._say = say
        self._watch = watch
        self._show = show
        self._clear = clear
        self._queue: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()

    def progress(self, progress: Progress) -> None:
        """Show the progress of the run if there is time for it."""
        if self._queue.empty():
            self._queue.put(lambda: self._show(self._watch.take(progress)))

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show a sentence, above the bar if there is one."""
        where = who if step < 0 else f"{who} at step {step}"
        self.say(f"{level}: {where}: {text}")

    def say(self, text: str) -> None:
        """Show a line, above the bar if there is one."""
        self._queue.put(partial(self._say, text))

    def next_run(self) -> None:
        """Take the progress of the next run from now on."""
        self._queue.put(self._watch.next_run)

    def close(self) -> None:
        """Show what is left if the terminal accepts it, then remove the bar."""
        self._queue.put(self._clear)
        self._queue.put(None)
        self._thread.join(_LAST_S)

    def _work(self) -> None:
        while (show := self._queue.get()) is not None:  # no time-out: a daemon thread
            show()


def _print(console: Console, text: str) -> None:
    console.print(fold(visible(text), console.width, INDENT), markup=False, soft_wrap=True)


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
    # The stream itself: a run in one process replaces `sys.stdout` during a participant's turn,
    # and what this prints from its own thread would land in that participant's log.
    stream = sys.stderr if quiet else sys.stdout
    watch = RunWatch(title, degrees=degrees, runs=runs)
    with contextlib.closing(
        Display(partial(print_line, stream), _do_nothing, _do_nothing, watch)
        if plain or quiet
        else Display(*shows_progress(stream, (HELP,) if keys else ()), watch)
    ) as display:
        yield display


def _do_nothing(*_: object) -> None: ...


def shows_progress(
    stream: IO[str], below: tuple[str, ...] = ()
) -> tuple[Callable[[str], None], Callable[[Reached], None], Callable[[], None]]:
    """Return what prints a line, what shows how far a command is, and what ends that.

    It is a bar, or lines where none can be drawn. below: lines below the bar.
    """
    if not has_screen(stream):
        say = partial(print_line, stream)
        return say, CalmLines(say).show, _do_nothing
    from rich.console import Console  # noqa: PLC0415  (there is nothing to draw in a pipe)

    console = Console(file=stream)
    bar = Bar(console, below)
    return partial(_print, console), bar.show, bar.close


class RunWatch:
    """Says how far a run is, and how fast it is now, from one report after the other.

    runs: how many there are in all, one after the other.
    """

    def __init__(self, title: str, *, degrees: bool = False, runs: int = 1) -> None:
        self._title = title
        self._degrees = degrees
        self._runs = runs
        self._run = 1
        self._rate = Rate()
        self._step = -1

    def next_run(self) -> None:
        """Take reports of the next run from now on."""
        self._run += 1

    def take(self, progress: Progress) -> Reached:
        """Take the next report."""
        steps = progress.steps or 0
        done, total = (self._run - 1) * steps + progress.step, self._runs * steps
        rate = self._rate.take(progress.elapsed_s, done, is_moving=progress.phase == "stepping")
        if progress.phase in {"starting", "paused"}:
            rate = None
        reached = Reached(
            title=self._title,
            what=_what(progress) + f", run {self._run} of {self._runs}" * (self._runs > 1),
            done=done,
            total=total or None,
            rate=f"{_factor(rate * progress.step_ns * 1e-9)} × real time" if rate else "",
            left_s=(total - done) / rate if rate and total else None,
            is_paused=progress.phase == "paused",
            note=in_degrees(progress) if self._degrees else "",
            detail=self._detail(progress, rate),
        )
        self._step = progress.step
        return reached

    def _detail(self, progress: Progress, rate: float | None) -> str:
        """Return what slows the run."""
        facts = [f"{rate:.0f} steps/s"] if rate else []
        if progress.step == self._step and progress.holders:
            facts.append(f"waits for {', '.join(progress.holders)}")
        elif progress.compute_us:
            slowest = max(progress.compute_us, key=lambda name: progress.compute_us[name])
            facts.append(f"slowest: {slowest}, {progress.compute_us[slowest]:.0f} µs a step")
        dropped = [f"{count} by {name}" for name, count in progress.drops.items() if count]
        return "; ".join([*facts, *([f"dropped: {', '.join(dropped)}"] if dropped else [])])


def _factor(factor: float) -> str:
    return f"{factor:.1f}" if factor >= 1 else f"{factor:.2g}"


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
