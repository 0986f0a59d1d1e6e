"""How fast a run goes by the wall clock, as the user asks while it goes on."""

import time
from collections.abc import Callable

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.gates import FAR

_BEHIND_S = 0.1
"""Who is further behind than this starts anew: a run that was paused does not hurry."""


class Speed(RunExtension):
    """Holds steps until their time by the wall clock; without a factor, it holds none.

    It only chooses when a trigger is sent: inputs are fixed by their step numbers, so it changes no
    result. step_ns: length of a step [ns]. clock: monotonic [s].
    """

    def __init__(self, step_ns: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._step_s = step_ns * 1e-9
        self._clock = clock
        self.factor: float | None = None
        self._origin = (0.0, 0)

    def set(self, factor: float | None, released: int) -> None:
        """Go so many times as fast as real time; None: as fast as possible.

        released: steps below it have been released.
        """
        self.factor = factor
        self._origin = (self._clock(), released)

    def limit(self, released: int) -> int:
        """Return the first step whose time has not come."""
        if self.factor is None:
            return FAR
        period_s = self._step_s / self.factor
        now, (began, first) = self._clock(), self._origin
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
        left_s = due - self._clock()
        return min(left_s, longest_s) if left_s > 0 else longest_s
