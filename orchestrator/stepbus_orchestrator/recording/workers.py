"""Work on big messages in threads: hashing and compressing let go of Python's lock meanwhile."""

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

T = TypeVar("T")

_BATCH_BYTES = 1024 * 1024
"""So much is handed to a thread at once: to wake it takes as long as to hash 20 kB."""
_AHEAD = 4
"""How many batches may wait: it bounds the memory, and whoever gives more waits for the oldest."""
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
        self._batch: list[Callable[[], T]] = []
        self._batch_bytes = 0
        self._given: deque[Future[tuple[list[T], BaseException | None]]] = deque()

    @property
    def are_busy(self) -> bool:
        """Return whether any result has still to be taken."""
        return bool(self._given or self._batch)

    def give(self, work: Callable[[], T], size: int) -> None:
        """Have work done on so many bytes; takes the oldest results where too much waits."""
        self._batch.append(work)
        self._batch_bytes += size
        if self._batch_bytes >= _BATCH_BYTES:
            self._hand_over()

    def _hand_over(self) -> None:
        batch, self._batch, self._batch_bytes = self._batch, [], 0
        if len(self._given) >= _AHEAD:
            self._take_next()
        try:
            self._given.append(self._pool.submit(_results, batch))
        except RuntimeError:
            # The limit of threads or of memory is reached: no more are started.
            self._pool.shutdown(wait=False)
            self._given.append(Future())
            self._given[-1].set_result(_results(batch))

    def drain(self) -> None:
        """Take all results that are not taken yet."""
        if self._batch:
            self._hand_over()
        while self._given:
            self._take_next()

    def _take_next(self) -> None:
        results, error = self._given.popleft().result()  # no time-out: its work is bounded
        for result in results:
            self._take(result)
        if error is not None:
            raise error

    def close(self) -> None:
        """End the threads; results that were not taken are dropped. Nothing can be given then."""
        self._batch.clear()
        self._given.clear()
        self._pool.shutdown(cancel_futures=True)


def _results(batch: Sequence[Callable[[], T]]) -> tuple[list[T], BaseException | None]:
    """Return what came of each piece of work, up to the first that failed, and its exception."""
    results: list[T] = []
    try:
        for work in batch:
            result = work()
            results.append(result)
    except BaseException as exc:  # noqa: BLE001  (raised where its result would be taken)
        return results, exc
    return results, None
