"""Show the progress of a run: one bar in a terminal, a few lines elsewhere."""

import contextlib
import math
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from stepbus_orchestrator.cli.terminal.keys import HELP
from stepbus_orchestrator.cli.terminal.progress import Lines, Reached, open_screen
from stepbus_orchestrator.run.reports import Observer, Progress

if TYPE_CHECKING:
    from stepbus_orchestrator.cli.terminal.bar import Bar

_SMOOTH_S = 4.0
"""How long a new rate takes to count for the most part [s]."""
_LEAST_RATE = 0.01
"""What is slower stands still [steps/s]."""


class Display(Observer):
    """Shows on a screen how far a run is, and how fast it is now, and what it reports.

    degrees: with the angles of all joints. runs: how many there are, one after the other.
    has_progress: otherwise it shows sentences only.
    """

    def __init__(
        self,
        screen: "Lines | Bar",
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
        self._rate: float | None = None
        self._last: Progress | None = None

    def progress(self, progress: Progress) -> None:
        """Show the progress of the run."""
        if self._has_progress:
            self._screen.show(self.reached(progress))

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show a sentence, above the bar if there is one."""
        where = who if step < 0 else f"{who} at step {step}"
        self.say(f"{level}: {where}: {text}")

    def say(self, text: str) -> None:
        """Show a line, above the bar if there is one."""
        self._screen.say(text)

    def next_run(self) -> None:
        """Take the progress of the next run from now on."""
        self._run += 1
        self._last = None

    def reached(self, progress: Progress) -> Reached:
        """Return how far the run is, by its newest report."""
        is_held = self._last is not None and progress.step == self._last.step
        rate = self._newest_rate(progress)
        steps = progress.steps or 0
        done, total = (self._run - 1) * steps + progress.step, self._runs * steps
        return Reached(
            title=self._title,
            what=_what(progress) + f", run {self._run} of {self._runs}" * (self._runs > 1),
            done=done,
            total=total or None,
            rate=f"{_factor(rate * progress.step_ns * 1e-9)} × real time" if rate else "",
            left_s=(total - done) / rate if rate and total else None,
            is_paused=progress.phase == "paused",
            note=in_degrees(progress) if self._degrees else "",
            detail=_detail(progress, rate, is_held=is_held),
        )

    def _newest_rate(self, progress: Progress) -> float | None:
        """Return the smoothed rate [steps/s] while the run moves."""
        last, self._last = self._last, progress
        if progress.phase != "stepping":
            return None
        passed_s = progress.elapsed_s - last.elapsed_s if last and last.phase == "stepping" else 0.0
        if last is not None and passed_s > 0:
            newest = (progress.step - last.step) / passed_s
            kept = 0.0 if self._rate is None else math.exp(-passed_s / _SMOOTH_S)
            self._rate = kept * (self._rate or 0.0) + (1 - kept) * newest
        return self._rate if (self._rate or 0.0) > _LEAST_RATE else None


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


def _detail(progress: Progress, rate: float | None, *, is_held: bool) -> str:
    """Return what slows the run. is_held: it has not moved since the last report."""
    facts = [f"{rate:.0f} steps/s"] if rate else []
    if is_held and progress.holders:
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
