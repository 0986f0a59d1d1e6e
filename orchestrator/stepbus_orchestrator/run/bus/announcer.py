"""What the orchestrator tells everybody: start, how far to go, stop."""

from __future__ import annotations

import time
from collections.abc import Callable

from stepbus_orchestrator.processes.watchdog import Watchdog
from stepbus_participant import Bus
from stepbus_schemas import Stop, Trigger, encode, encoding_of

_FIRST_S = 0.05
_FIRST_STOP_S = 0.01
_LONGEST_S = 60.0


class Announcer:
    """Tells all participants the newest word, and says it again while nothing comes of it.

    What is published before a link is complete is lost, so it is repeated; less and less often,
    since a participant that is frozen reads nothing, and each message to it fills a buffer.

    limit_s: how long it may take to send a message [s]. free: is called, on another thread, when
    it takes longer, and has to end whoever reads nothing.
    """

    def __init__(self, bus: Bus, token: str, limit_s: float, free: Callable[[], None]) -> None:
        self._token = token
        self._put_start = bus.publisher("start", encoding_of("Start/1"))
        self._put_trigger = bus.publisher("trigger", encoding_of("Trigger/1"))
        self._put_stop = bus.publisher("stop", encoding_of("Stop/1"))
        self._watchdog = Watchdog(limit_s, free)
        self._start = b""
        self._stop = b""
        self._step_limit = 0
        self._pause_s = _FIRST_S
        self._due_s = 0.0

    def start(self, message: bytes) -> None:
        """Send the `Start`."""
        self._start = message
        self._send(self._put_start, message)

    def trigger(self, step_limit: int) -> None:
        """Let everybody work on the steps below `step_limit`."""
        self._step_limit = step_limit
        self._pause_s = _FIRST_S
        self._due_s = time.monotonic() + _FIRST_S
        self._send(self._put_trigger, self._trigger())

    def stop(self, reason: str, at_step: int) -> None:
        """Let everybody end; negative `at_step`: at once."""
        self._stop = encode(Stop(token=self._token, reason=reason, at_step=at_step))
        self._pause_s = _FIRST_STOP_S
        self._due_s = time.monotonic() + _FIRST_STOP_S
        self._send(self._put_stop, self._stop)

    def repeat(self, *, start: bool) -> None:
        """Say again how far to go, when it is time to; start: and that the run has started."""
        if self._is_time():
            if start:
                self._send(self._put_start, self._start)
            self._send(self._put_trigger, self._trigger())

    def repeat_stop(self) -> None:
        """Say again that the run ends, when it is time to."""
        if self._is_time():
            self._send(self._put_stop, self._stop)

    def close(self) -> None:
        """Say no more."""
        self._watchdog.close()

    def _trigger(self) -> bytes:
        return encode(Trigger(token=self._token, step_limit=self._step_limit))

    def _is_time(self) -> bool:
        now = time.monotonic()
        if now < self._due_s:
            return False
        self._pause_s = min(2 * self._pause_s, _LONGEST_S)
        self._due_s = now + self._pause_s
        return True

    def _send(self, put: Callable[..., None], data: bytes) -> None:
        self._watchdog.begin()
        put(data)
        self._watchdog.end()
