"""Work on big messages in threads: hashing and compressing let go of Python's lock meanwhile."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")

_AHEAD = 8
"""How many pieces may wait: it bounds the memory, and whoever gives more waits for the oldest."""


class _Piece(Generic[T]):
    """A piece of work for a thread; once `over` is free, it has a result or an error."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._error: BaseException | None = None
        self.over = threading.Lock()
        self.over.acquire()  # no time-out: it is free, being new

    def run(self) -> None:
        """Do the work."""
        try:
            self._result = self._work()
        except BaseException as exc:  # noqa: BLE001  (raised where its result would be taken)
            self._error = exc
        finally:
            self.over.release()

    def result(self) -> T:
        """Return the result once it is there; raises what the work has raised."""
        self.over.acquire()  # no time-out: its work is bounded by a chunk
        if self._error is not None:
            raise self._error
        return self._result


class Workers(Generic[T]):
    """Does work in threads, and takes the results in the order in which the work was given.

    take: gets each result, in the thread that calls a method here. When it does depends on these
    calls alone, neither on time nor on how many threads there are. threads: with one, the work is
    done in order too. `concurrent.futures` takes 10 ms to import.

    An exception of the work is raised where its result would be taken.
    """

    def __init__(self, take: Callable[[T], None], threads: int = 2) -> None:
        self._take = take
        self._most = threads
        self._threads: list[threading.Thread] = []
        self._todo: SimpleQueue[_Piece[T] | None] = SimpleQueue()
        self._given: deque[_Piece[T]] = deque()

    @property
    def are_busy(self) -> bool:
        """Return whether any result has still to be taken."""
        return bool(self._given)

    def give(self, work: Callable[[], T]) -> None:
        """Have work done; takes the oldest result where too much waits."""
        if len(self._given) >= _AHEAD:
            self._take_next()
        # At the limit of threads or of memory, it does with those it has.
        with contextlib.suppress(RuntimeError):
            while len(self._threads) < self._most:
                thread = threading.Thread(target=self._run, name="recording", daemon=True)
                thread.start()
                self._threads.append(thread)
        piece = _Piece(work)
        self._given.append(piece)
        if self._threads:
            self._todo.put(piece)
        else:
            piece.run()

    def drain(self) -> None:
        """Take all results that are not taken yet."""
        while self._given:
            self._take_next()

    def _take_next(self) -> None:
        self._take(self._given.popleft().result())

    def close(self) -> None:
        """End the threads; results that were not taken are dropped. Nothing can be given then."""
        self._given.clear()
        for _ in self._threads:
            self._todo.put(None)
        for thread in self._threads:
            thread.join()  # no time-out: its work is bounded by a chunk

    def _run(self) -> None:
        # no time-out: `close` gives it None
        while (piece := self._todo.get()) is not None:
            piece.run()
            del piece
