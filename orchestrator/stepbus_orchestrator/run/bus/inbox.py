"""Carries what the bus delivers to the run's own thread; a run waits nowhere else."""

from collections import deque
from collections.abc import Callable, Iterable
from queue import Empty
from typing import Any

from stepbus_participant import Queue


class Inbox:
    """A queue of what has arrived, each item with the function that takes it.

    Callbacks of the bus only put; everything else happens on the thread that calls `receive`.
    What several participants have to send before anything can go on wakes that thread once.

    queue: of the bus.
    """

    def __init__(self, queue: Queue) -> None:
        self._queue = queue
        self._quiet: deque[tuple[Callable[[Any], None], Any]] = deque()
        self._awaited: set[str] = set()

    def into(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback for the bus: what it gets is passed to `take` by `receive`."""
        put = self._queue.put
        return lambda item: put((take, item))

    def into_from(self, name: str, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the same for a participant; it wakes nobody while others are awaited."""
        put, keep = self._queue.put, self._quiet.append

        def sink(item: Any) -> None:
            keep((take, item))
            # Read behind the line above: `wake_for` looks for what was kept once it has set this.
            awaited = self._awaited
            awaited.discard(name)
            if not awaited:
                put((_ignore, None))

        return sink

    def wake_for(self, names: Iterable[str]) -> None:
        """Let `receive` wake up once each of these has sent something; none: for anybody."""
        self._awaited = set(names)

    def receive(self, timeout_s: float) -> None:
        """Wait for the next item, at most for a time [s], and take all that have come with it."""
        if self._quiet:
            timeout_s = 0.0
        try:
            take, item = self._queue.get(timeout=timeout_s)
        except Empty:
            self._take_quiet()
            return
        self._take_quiet()
        take(item)
        # Not until it is empty: a process that floods the bus must not keep us from the deadlines.
        for _ in range(self._queue.qsize()):
            take, item = self._queue.get()  # no time-out: it is not empty
            if take is not _ignore:
                self._take_quiet()
                take(item)

    def _take_quiet(self) -> None:
        """Take what has woken nobody; it came before all that is taken next."""
        for _ in range(len(self._quiet)):
            take, item = self._quiet.popleft()
            take(item)


def _ignore(_item: object) -> None:
    """Take what only wakes."""
