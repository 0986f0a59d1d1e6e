"""Work on big messages in threads: hashing and compressing let go of Python's lock meanwhile."""

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

T = TypeVar("T")

_AHEAD = 4
"""How much work may wait: it bounds the memory, and whoever gives more waits for the oldest."""
MOST_THREADS = min(_AHEAD, os.cpu_count() or 1)


class Workers(Generic[T]):
    """Does work in threads, and takes the results in the order in which the work was given.

    take: gets each result, in the thread that calls a method here. When it does depends on these
    calls alone, neither on time nor on how many threads there are. threads: with one, the work is
    done in order too.

    An exception of the work is raised where its result would be taken.
    """

    def __init__(self, take: Callable[[T], None], threads: int = MOST_THREADS) -> None:
        self._take = take
        self._pool = ThreadPoolExecutor(threads, "recording")
        self._given: deque[Future[T]] = deque()

    @property
    def are_busy(self) -> bool:
        """Return whether any result has still to be taken."""
        return bool(self._given)

    def give(self, work: Callable[[], T]) -> None:
        """Have work done; takes the oldest result where too much waits."""
        if len(self._given) >= _AHEAD:
            self._take_next()
        self._given.append(self._pool.submit(work))

    def drain(self) -> None:
        """Take all results that are not taken yet."""
        while self._given:
            self._take_next()

    def _take_next(self) -> None:
        result = self._given[0].result()
        self._given.popleft()
        self._take(result)

    def close(self) -> None:
        """End the threads; results that were not taken are dropped. Nothing can be given then."""
        self._given.clear()
        self._pool.shutdown(cancel_futures=True)
