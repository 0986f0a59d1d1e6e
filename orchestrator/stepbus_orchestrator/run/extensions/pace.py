"""Pauses a run, lets it make single steps, and ends it."""

import threading

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.barrier import FAR


class Pace(RunExtension):
    """Pauses a run between two steps, resumes and ends it, from any thread.

    A pause only delays triggers, so it does not change the result. is_stopping: whether the run was
    asked to end. at: step to pause before;
    default: run until `pause` is called.
    """

    def __init__(self, at: int | None = None) -> None:
        self._lock = threading.Lock()
        self._at = at
        self._pausing = False
        self._more = 0
        self.is_stopping = False

    @property
    def paused(self) -> bool:
        """Return whether the run is paused, or will pause at a step."""
        return self._pausing or self._at is not None

    def pause(self) -> None:
        """Pause when all released steps are complete."""
        with self._lock:
            self._pausing, self._at = True, None

    def resume(self) -> None:
        """Continue the run."""
        with self._lock:
            self._pausing, self._at, self._more = False, None, 0

    def step(self, count: int = 1) -> None:
        """Run a number of steps, then pause."""
        with self._lock:
            self._pausing = True
            self._more += count

    def stop(self) -> None:
        """End the run after the steps that are released: it has finished, as the user wants."""
        self.is_stopping = True

    def limit(self, released: int) -> int:
        """Return the first step that must not be released yet."""
        if self.is_stopping:
            if self.run.state.end is None:
                self.run.end("stopped by the user")
            return self.run.state.last_step
        with self._lock:
            if self._pausing:
                self._at = released if self._at is None else max(self._at, released)
                self._at, self._more, self._pausing = self._at + self._more, 0, False
            self.run.state.is_paused = self._at is not None
            return FAR if self._at is None else self._at
