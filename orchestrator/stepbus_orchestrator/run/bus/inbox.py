"""Carries what the bus delivers to the run's own thread; a run waits nowhere else."""

from collections.abc import Callable
from queue import Empty
from typing import Any

from stepbus_participant import Queue


class Inbox:
    """A queue of what has arrived, each item with the function that takes it.

    Callbacks of the bus only put; everything else happens on the thread that calls `receive`.

    queue: of the bus.
    """

    def __init__(self, queue: Queue) -> None:
        self._queue = queue

    def into(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback for the bus: what it gets is passed to `take` by `receive`."""
        put = self._queue.put
        return lambda item: put((take, item))

    def receive(self, timeout_s: float) -> None:
        """Wait for the next item, at most for a time [s], and take all that have come with it."""
        try:
            take, item = self._queue.get(timeout=timeout_s)
        except Empty:
            return
        take(item)
        # Not until it is empty: a process that floods the bus must not keep us from the deadlines.
        for _ in range(self._queue.qsize()):
            take, item = self._queue.get()
            take(item)
