"""Frees whoever sends to a program that takes in nothing, and would be blocked for good.

Publishers block rather than drop (P2.5). A frozen process reads nothing; when the buffers of its
link are full, which takes some 250 messages however small, a put to it never returns.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

_LOOK_S = 0.1


class Watchdog:
    """Watches the calls that a program which reads nothing would block for ever.

    limit_s: how long such a call may take [s]. kill: ends the program, which frees the call; it
    runs on the watchdog's thread.
    """

    def __init__(self, limit_s: float, kill: Callable[[], None]) -> None:
        self.has_bitten = False
        self._limit_s = limit_s
        self._kill = kill
        self._since: float | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._thread.start()

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Watch what is done in this context."""
        self.begin()
        try:
            yield
        finally:
            self.end()

    def begin(self) -> None:
        """Watch what is done from now on."""
        self._since = time.monotonic()

    def end(self) -> None:
        """Watch no longer, until the next `begin`."""
        self._since = None

    def close(self) -> None:
        """Watch no longer."""
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(_LOOK_S):
            since = self._since
            if since is not None and time.monotonic() - since > self._limit_s:
                self.has_bitten = True
                self._kill()
                self._since = time.monotonic()
