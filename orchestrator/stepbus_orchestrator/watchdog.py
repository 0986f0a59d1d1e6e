"""Kills a program that takes in nothing, so that whoever sends to it is not blocked for good."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

_LOOK_S = 0.1


class Watchdog:
    """Watches the calls that a program which reads nothing would block for ever.

    limit_s: how long such a call may take [s]. kill: ends the program, which frees the call.
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
        self._since = time.monotonic()
        try:
            yield
        finally:
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
