"""Pause, resume and single steps: how far a run may go, as the user wants it."""

from __future__ import annotations

import threading
from typing import Protocol

FAR = 1 << 62
"""Beyond the last step of any run."""


class Gate(Protocol):
    """Somebody who may keep a run from going on."""

    def limit(self, released: int) -> int:
        """Return the step that must not be worked on yet, nor any after it.

        released: steps below it are being worked on, or done. Called again and again.
        """


class Pace:
    """Holds a run between two steps, and lets it go on; from any thread.

    It only chooses when a trigger is sent: inputs are fixed by their step numbers, so a pause
    changes no result. at: the step to stop before; none: the run goes on until `pause`.
    """

    def __init__(self, at: int | None = None) -> None:
        self._lock = threading.Lock()
        self._at = at
        self._pausing = False
        self._more = 0

    @property
    def paused(self) -> bool:
        """Return whether the run is held, or will be at a step."""
        return self._pausing or self._at is not None

    def pause(self) -> None:
        """Hold the run as soon as all that is being worked on is done."""
        with self._lock:
            self._pausing, self._at = True, None

    def resume(self) -> None:
        """Let the run go on."""
        with self._lock:
            self._pausing, self._at, self._more = False, None, 0

    def step(self, count: int = 1) -> None:
        """Let the run go on by a number of steps and hold it then."""
        with self._lock:
            self._pausing = True
            self._more += count

    def limit(self, released: int) -> int:
        """Return the step that must not be worked on yet."""
        with self._lock:
            if self._pausing:
                self._at = released if self._at is None else max(self._at, released)
                self._at, self._more, self._pausing = self._at + self._more, 0, False
            return FAR if self._at is None else self._at
