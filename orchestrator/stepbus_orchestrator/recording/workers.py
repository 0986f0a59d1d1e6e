"""Work on big messages in threads: hashing and compressing let go of Python's lock meanwhile."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_MOST = 4


class _Piece(threading.Thread, Generic[T]):
    """A piece of work in a thread of its own; error: what it raised."""

    def __init__(self, work: Callable[[], T]) -> None:
        super().__init__(name="recording", daemon=True)
        self._work = work
        self.error: BaseException | None = None

    def run(self) -> None:
        """Do the work."""
        try:
            self._value = self._work()
        except BaseException as exc:  # noqa: BLE001  (raised where its result would be taken)
            self.error = exc

    def wait(self) -> None:
        """Wait until the work is done."""
        if self.ident is not None:
            self.join()  # no time-out: its work is bounded by a chunk

    def result(self) -> T:
        """Return the result once it is there; raises what the work raised."""
        self.wait()
        if self.error is not None:
            raise self.error
        return self._value


class Workers(Generic[T]):
    """Does work in threads, and takes the results in the order in which the work was given.

    take: gets each result, in the thread that calls a method here. When it does depends on these
    calls alone, not on time. most: pieces of work at a time; it bounds the memory too.
    `concurrent.futures` takes 10 ms to import.

    An exception of the work is raised where its result would be taken.
    """

    def __init__(self, take: Callable[[T], None], most: int = _MOST) -> None:
        self._take = take
        self._most = most
        self._given: deque[_Piece[T]] = deque()

    @property
    def are_busy(self) -> bool:
        """Return whether any result has still to be taken."""
        return bool(self._given)

    def give(self, work: Callable[[], T]) -> None:
        """Begin a piece of work; takes the oldest result first where too much waits."""
        if len(self._given) >= self._most:
            self._take_next()
        piece = _Piece(work)
        try:
            piece.start()
        except RuntimeError:
            # At the limit of threads, it is done here.
            piece.run()
        self._given.append(piece)

    def drain(self) -> None:
        """Take all results that are not taken yet."""
        while self._given:
            self._take_next()

    def _take_next(self) -> None:
        self._take(self._given.popleft().result())

    def close(self) -> None:
        """Wait for the threads; results that were not taken are dropped."""
        while self._given:
            self._given.popleft().wait()
