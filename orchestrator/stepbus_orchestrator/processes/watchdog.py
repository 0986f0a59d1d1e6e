"""Kills a program that reads nothing, so that no publisher to it is not blocked for good.

Publishers block rather than drop (P2.5). A frozen process reads nothing; when the buffers of its
link are full, which takes some 250 messages however small, a put to it never returns.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

from stepbus_participant import Clock

_CHECK_S = 0.1
_LONGEST_CHECK_S = 0.25
"""One check counts for at most this long: a suspended machine or orchestrator is no blocker."""

_JOIN_S = 1.0


class Watchdog:
    """Times the calls that a program which reads nothing would block forever.

    limit_s: how long such a call may take [s]. kill: ends the program, which frees the call; runs
    on the watchdog's thread, and again after `limit_s` where that freed nothing. fired: whether it
    has killed.
    """

    def __init__(self, limit_s: float, kill: Callable[[], None], clock: Clock = time) -> None:
        self.fired = False
        self._limit_s = limit_s
        self._kill = kill
        self._clock = clock
        self._call = 0
        self._is_open = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._thread.start()

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

    def close(self) -> None:
        """Stop watching for good."""
        self._over.set()
        self._thread.join(_JOIN_S)

    def _watch(self) -> None:
        call, blocked_s, checked_at = 0, 0.0, self._clock.monotonic()
        while not self._over.wait(_CHECK_S):
            now = self._clock.monotonic()
            elapsed_s, checked_at = min(now - checked_at, _LONGEST_CHECK_S), now
            if not self._is_open or self._call != call:
                call, blocked_s = self._call, 0.0
                continue
            blocked_s += elapsed_s
            if blocked_s > self._limit_s:
                blocked_s = 0.0
                self.fired = True
                self._kill()
