"""All that the orchestrator publishes: start, trigger, stop, and what it sends to single ones."""

import time
from collections.abc import Callable

from stepbus_orchestrator.processes.watchdog import Watchdog
from stepbus_participant import Bus, Request
from stepbus_schemas import CallReply, Refusal, Stop, Trigger, Welcome, encode, encoding_of

_FIRST_S = 0.05
_FIRST_STOP_S = 0.01
_LONGEST_S = 60.0


class Announcer:
    """Publishes, under a watchdog: a put to a process that reads nothing blocks (P2.5).

    Start, trigger and stop are repeated until their effect is seen, since what is published before
    a link is complete is lost; less and less often, since each message to a frozen participant
    fills a buffer.

    limit_s: how long a put may block [s]. on_block: is called on the watchdog's thread when one
    takes longer, and has to end the process that reads nothing.
    """

    def __init__(self, bus: Bus, token: str, limit_s: float) -> None:
        self.on_block: Callable[[], None] = lambda: None
        self._bus = bus
        self._token = token
        self._watchdog = Watchdog(limit_s, self._blocked)
        self._put_start = self.publisher("start", "Start/1")
        self._put_trigger = self.publisher("trigger", "Trigger/1")
        self._put_stop = self.publisher("stop", "Stop/1")
        self._start = b""
        self._stop = b""
        self._step_limit = 0
        self._pause_s = _FIRST_S
        self._due_s = 0.0

    def publisher(self, key: str, type_name: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes on a key; it takes `attachment=` bytes too.

        remote: the orchestrator's own subscribers do not get them.
        """
        put = self._bus.publisher(key, encoding_of(type_name), remote=remote)
        start, end = self._watchdog.start, self._watchdog.end

        def watched_put(data: bytes, **options: bytes) -> None:
            start()
            try:
                put(data, **options)
            finally:
                end()

        return watched_put

    def reply(self, request: Request, message: Welcome | Refusal | CallReply) -> None:
        """Answer a query with an envelope."""
        with self._watchdog.watching():
            request.reply(encode(message), encoding_of(f"{type(message).__name__}/1"))

    def start(self, message: bytes) -> None:
        """Publish the `Start` (P4.8)."""
        self._start = message
        self._put_start(message)

    def trigger(self, step_limit: int) -> None:
        """Let everybody work on the steps below `step_limit` (P5.2)."""
        self._step_limit = step_limit
        self._set_pause(_FIRST_S)
        self._put_trigger(self._trigger())

    def stop(self, reason: str, at_step: int) -> None:
        """Let everybody end; negative `at_step`: at once (P11.1)."""
        self._stop = encode(Stop(token=self._token, reason=reason, at_step=at_step))
        self._set_pause(_FIRST_STOP_S)
        self._put_stop(self._stop)

    def repeat(self, *, with_start: bool) -> None:
        """Repeat the newest trigger, when it is time to; with_start: the `Start` as well."""
        if self._is_time():
            if with_start:
                self._put_start(self._start)
            self._put_trigger(self._trigger())

    def repeat_stop(self) -> None:
        """Repeat the `Stop`, when it is time to."""
        if self._is_time():
            self._put_stop(self._stop)

    def close(self) -> None:
        """Stop the watchdog; nothing is published afterwards."""
        self._watchdog.close()

    def _blocked(self) -> None:
        self.on_block()

    def _trigger(self) -> bytes:
        return encode(Trigger(token=self._token, step_limit=self._step_limit))

    def _set_pause(self, pause_s: float) -> None:
        self._pause_s = pause_s
        self._due_s = time.monotonic() + pause_s

    def _is_time(self) -> bool:
        now = time.monotonic()
        if now < self._due_s:
            return False
        self._pause_s = min(2 * self._pause_s, _LONGEST_S)
        self._due_s = now + self._pause_s
        return True
