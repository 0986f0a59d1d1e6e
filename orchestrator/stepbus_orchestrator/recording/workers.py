"""Work on big messages in threads: hashing and compressing let go of Python's lock meanwhile."""

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")

_BATCH_BYTES = 1024 * 1024
"""So much is handed to a thread at once: to wake it takes as long as to hash 20 kB."""
_AHEAD = 4
"""How many batches may wait: it bounds the memory, and whoever gives more waits for the oldest."""
MOST_THREADS = min(_AHEAD, os.cpu_count() or 1)


class _Batch(Generic[T]):
    """Pieces of work for one thread; once `over` is free, their results.

    error: of the piece that has failed, which is the last that was begun.
    """

    def __init__(self) -> None:
        self.work: list[Callable[[], T]] = []
        self.size = 0
        self.results: list[T] = []
        self.error: BaseException | None = None
        self.over = threading.Lock()
        self.over.acquire()  # no time-out: it is free, being new

    def run(self) -> None:
        """Do the work, in its order."""
        try:
            for do in self.work:
                self.results.append(do())
        except BaseException as exc:  # noqa: BLE001  (raised where its result would be taken)
            self.error = exc
        finally:
            self.over.release()


class Workers(Generic[T]):
    """Does work in threads, and takes the results in the order in which the work was given.

    take: gets each result, in the thread that calls a method here. When it does depends on these
    calls alone, neither on time nor on how many threads there are. threads: with one, the work is
    done in order too. `concurrent.futures` takes 10 ms to import.

    An exception of the work is raised where its result would be taken.
    """

    def __init__(self, take: Callable[[T], None], threads: int = MOST_THREADS) -> None:
        self._take = take
        self._most = threads
        self._threads: list[threading.Thread] = []
        self._todo: SimpleQueue[_Batch[T] | None] = SimpleQueue()
        self._batch = _Batch[T]()
        self._given: deque[_Batch[T]] = deque()

    @property
    def are_busy(self) -> bool:
        """Return whether any result has still to be taken."""
        return bool(self._given or self._batch.work)

    def give(self, work: Callable[[], T], size: int) -> None:
        """Have work done on so many bytes; takes the oldest results where too much waits."""
        self._batch.work.append(work)
        self._batch.size += size
        if self._batch.size >= _BATCH_BYTES:
            self._hand_over()

    def _hand_over(self) -> None:
        batch, self._batch = self._batch, _Batch[T]()
        if len(self._given) >= _AHEAD:
            self._take_next()
        # At the limit of threads or of memory, it does with those it has.
        with contextlib.suppress(RuntimeError):
            while len(self._threads) < self._most:
                thread = threading.Thread(target=self._run, name="recording", daemon=True)
                thread.start()
                self._threads.append(thread)
        self._given.append(batch)
        if self._threads:
            self._todo.put(batch)
        else:
            batch.run()

    def drain(self) -> None:
        """Take all results that are not taken yet."""
        if self._batch.work:
            self._hand_over()
        while self._given:
            self._take_next()

    def _take_next(self) -> None:
        batch = self._given.popleft()
        batch.over.acquire()  # no time-out: its work is bounded by a chunk
        for result in batch.results:
            self._take(result)
        if batch.error is not None:
            raise batch.error

    def close(self) -> None:
        """End the threads; results that were not taken are dropped. Nothing can be given then."""
        for batch in (self._batch, *self._given):
            batch.work.clear()
        self._given.clear()
        for _ in self._threads:
            self._todo.put(None)
        for thread in self._threads:
            thread.join()  # no time-out: its work is bounded by a chunk

    def _run(self) -> None:
        # no time-out: `close` gives it None
        while (batch := self._todo.get()) is not None:
            batch.run()
            del batch
