"""Kills a program that reads nothing, so that no publisher to it is not blocked for good.

Publishers block rather than drop (P2.5). A frozen process reads nothing; when the buffers of its
link are full, which takes some 250 messages however small, a put to it never returns.
"""

import contextlib
import time
from collections.abc import Callable, Iterator

from stepbus_participant import Clock, every_on_a_thread

_CHECK_S = 0.1
_LONGEST_CHECK_S = 0.25
"""One check counts for at most this long: a suspended machine or orchestrator is no blocker."""


class Watchdog:
    """Times the calls that a program which reads nothing would block forever.

    limit_s: how long such a call may take [s]. kill: ends the program, which frees the call; runs
    on the watchdog's thread, and again after `limit_s` where that freed nothing. every: calls a
    function every so often, as that of a bus does.
    """

    def __init__(
        self,
        limit_s: float,
        kill: Callable[[], None],
        clock: Clock = time,
        every: Callable[[float, Callable[[], None]], Callable[[], None]] = every_on_a_thread,
    ) -> None:
        self._limit_s = limit_s
        self._kill = kill
        self._clock = clock
        self._call = self._checked_call = 0
        self._is_open = False
        self._blocked_s = 0.0
        self._checked_at = clock.monotonic()
        self.close = every(_CHECK_S, self._check)
        """Stop watching for good."""

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Watch what is done in this context."""
        self.start()
        try:
            yield
        finally:
            self.end()

    def start(self) -> None:
        """Watch the call that starts now."""
        self._call += 1
        self._is_open = True

    def end(self) -> None:
        """Stop watching until the next `start`."""
        self._is_open = False

    def _check(self) -> None:
        now = self._clock.monotonic()
        elapsed_s = min(now - self._checked_at, _LONGEST_CHECK_S)
        self._checked_at = now
        if not self._is_open or self._call != self._checked_call:
            self._checked_call, self._blocked_s = self._call, 0.0
            return
        self._blocked_s += elapsed_s
        if self._blocked_s > self._limit_s:
            self._blocked_s = 0.0
            self._kill()
