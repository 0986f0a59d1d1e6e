"""Holds steps: a run is paused, makes single steps, or is as slow as the user likes."""

import threading
import time
from typing import TYPE_CHECKING

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_participant import Clock

if TYPE_CHECKING:
    from stepbus_orchestrator.run.run import Run

_BEHIND_S = 0.1
"""Who is further behind than this starts anew: a run that was paused does not hurry."""


class Speed(RunExtension):
    """Holds steps until their time by the wall clock; without a factor, it holds none.

    It only chooses when a trigger is sent: inputs are fixed by their step numbers, so it changes no
    result. step_ns: length of a step [ns]. clock: until it has a run.
    """

    def __init__(self, step_ns: int, clock: Clock = time) -> None:
        self._step_s = step_ns * 1e-9
        self._clock = clock
        self.factor: float | None = None
        self._origin = (0.0, 0)

    def attach(self, run: "Run") -> None:
        """Go by the clock of the run."""
        super().attach(run)
        self._clock = run.clock

    def set(self, factor: float | None, released: int) -> None:
        """Go so many times as fast as real time; None: as fast as possible.

        released: steps below it have been released.
        """
        self.factor = factor
        self._origin = (self._clock.monotonic(), released)

    def limit(self, released: int) -> int:
        """Return the first step whose time has not come."""
        if self.factor is None:
            return FAR
        period_s = self._step_s / self.factor
        now, (began, first) = self._clock.monotonic(), self._origin
        due = first + int((now - began) / period_s) + 1
        if (due - released) * period_s > max(_BEHIND_S, 2 * period_s):
            self._origin = (now, released)
            return released + 1
        return due

    def wait_s(self, released: int, longest_s: float) -> float | None:
        """Return how long to wait for messages, at most until the next step is due [s]."""
        if self.factor is None:
            return None
        began, first = self._origin
        due = began + (released - first) * self._step_s / self.factor
        left_s = due - self._clock.monotonic()
        return min(left_s, longest_s) if left_s > 0 else longest_s


class Pace(RunExtension):
    """Pauses a run between two steps and resumes it, from any thread.

    It only chooses when a trigger is sent: inputs are fixed by their step numbers, so a pause
    changes no result. at: the step to pause before; default: the run continues until `pause`.
    """

    def __init__(self, at: int | None = None) -> None:
        self._lock = threading.Lock()
        self._at = at
        self._pausing = False
        self._more = 0

    @property
    def paused(self) -> bool:
        """Return whether the run is paused, or will be at a step."""
        return self._pausing or self._at is not None

    def is_holding(self) -> bool:
        """Return whether the run is paused."""
        return self.paused

    def pause(self) -> None:
        """Pause as soon as all released steps are complete."""
        with self._lock:
            self._pausing, self._at = True, None

    def resume(self) -> None:
        """Let the run continue."""
        with self._lock:
            self._pausing, self._at, self._more = False, None, 0

    def step(self, count: int = 1) -> None:
        """Let the run continue for a number of steps, then pause."""
        with self._lock:
            self._pausing = True
            self._more += count

    def limit(self, released: int) -> int:
        """Return the first step that must not be released yet."""
        with self._lock:
            if self._pausing:
                self._at = released if self._at is None else max(self._at, released)
                self._at, self._more, self._pausing = self._at + self._more, 0, False
            return FAR if self._at is None else self._at
