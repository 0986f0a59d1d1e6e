"""A thread for work that need not be finished before the run goes on."""

import contextlib
import sys
from collections.abc import Callable
from queue import Queue
from threading import Thread


class Background:
    """Makes one call after the other on a thread, which starts with the first and ends with `end`.

    `start` and `settle` raise what the call before has raised. has_thread: if not, or where the
    machine allows no more threads, the caller's thread makes the calls.
    """

    def __init__(self, *, has_thread: bool) -> None:
        self._has_thread = has_thread
        self._thread: Thread | None = None
        self._calls: Queue[Callable[[], None] | None] = Queue()
        self._error: BaseException | None = None

    def start(self, call: Callable[[], None]) -> None:
        """Start a call, once the one before is over."""
        self.settle()
        if self._has_thread and self._thread is None:
            # Not before it is needed: no thread survives a fork.
            thread = Thread(target=self._work, name="recording", daemon=True)
            try:
                thread.start()
                self._thread = thread
            except RuntimeError:
                self._has_thread = False
        if self._thread is None:
            call()
        else:
            self._calls.put(call)

    def settle(self) -> None:
        """Wait until no call is in progress."""
        if self._thread is not None:
            self._calls.join()  # no time-out: a write on the caller's thread takes as long
        error, self._error = self._error, None
        if error is not None:
            raise error

    def end(self) -> None:
        """End the thread after the call in progress; harmless when repeated."""
        if self._thread is not None:
            self._calls.put(None)
            self._thread.join()  # no time-out: as in `settle`
            self._thread = None

    def _work(self) -> None:
        while call := self._calls.get():  # no time-out: `end` ends it, or the process
            with contextlib.suppress(BaseException):
                try:
                    call()
                finally:
                    # For `settle`.
                    self._error = sys.exc_info()[1]
                    self._calls.task_done()
