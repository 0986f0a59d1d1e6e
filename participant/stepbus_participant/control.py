"""What the orchestrator tells a participant: start, trigger, stop."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from queue import Empty, SimpleQueue
from typing import Any

from stepbus_schemas import Call, Decoder, Description, MessageError, RunError, Start, Stop, Trigger

from .bus import Bus

_decode_start = Decoder(Start)
_decode_trigger = Decoder(Trigger)
_decode_stop = Decoder(Stop)
_decode_call = Decoder(Call)
GONE = "gone"
_QUIET = ("trigger", "call")


class Stopped(Exception):
    """The orchestrator ended the run."""

    def __init__(self, stop: Stop) -> None:
        super().__init__(stop.reason)
        self.stop = stop


class OrchestratorLost(RunError, ConnectionError):
    """The orchestrator has gone without a word."""


class Control:
    """The newest word of the orchestrator.

    step_limit: steps below it may be worked on. started: descriptions of the inputs of all
    participants, once all are ready. calls: what it asks, to be answered while we wait for the
    trigger; only where it is given our `name`.

    A stop can overtake the last inputs, which come over other links. So it waits for `enter` to
    reach its step: what is published before that step belongs to the run.
    """

    def __init__(
        self, bus: Bus, token: str, wake: Iterable[SimpleQueue[Any]], name: str = ""
    ) -> None:
        self.step_limit = 0
        self.calls: deque[Call] = deque()
        self.started: Mapping[str, Mapping[str, Description]] | None = None
        self.unauthenticated = 0
        self._token = token
        self._step = -1
        self._stop: Stop | None = None
        self._bus = bus
        self._wake = list(wake)
        self._queue: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        for key in ("start", "trigger", "stop"):
            bus.subscribe(key, self._sink(key))
        if name:
            bus.subscribe(f"call/{name}", self._sink("call"))
        bus.watch_alive("alive/orchestrator", self._on_alive)

    def _sink(self, key: str) -> Any:
        def put(sample: Any) -> None:
            self._put(key, self._bus.payload(sample))

        return put

    def _on_alive(self, _key: str, alive: bool) -> None:
        if not alive:
            self._put(GONE, b"")

    def _put(self, key: str, data: bytes) -> None:
        """Queue a word, and wake whoever waits for an input."""
        self._queue.put((key, data))
        if key not in _QUIET:
            for queue in self._wake:
                queue.put(None)

    def enter(self, step: int) -> None:
        """Begin a step; raises Stopped when the run ends before it."""
        self._step = step
        if self._stop is not None:
            self._end_if_due(self._stop)

    def _end_if_due(self, stop: Stop) -> None:
        if self._step >= stop.at_step:
            raise Stopped(stop)

    def wait(self, timeout_s: float) -> bool:
        """Take in the next word; return whether there was one.

        Raises Stopped when the run ends, OrchestratorLost when the orchestrator has died.
        """
        try:
            key, data = self._queue.get(timeout=timeout_s)
        except Empty:
            return False
        self._take(key, data)
        return True

    def poll(self) -> None:
        """Take in the words that have come so far; raises as `wait` does."""
        for _ in range(self._queue.qsize()):
            self._take(*self._queue.get())

    def _take(self, key: str, data: bytes) -> None:
        if key == GONE:
            raise OrchestratorLost("the orchestrator has gone; this participant ends too")
        try:
            if key == "trigger":
                self._take_trigger(_decode_trigger(data))
            elif key == "stop":
                self._take_stop(_decode_stop(data))
            elif key == "call":
                self._take_call(_decode_call(data))
            else:
                self._take_start(_decode_start(data))
        except MessageError:
            self.unauthenticated += 1

    def _take_trigger(self, trigger: Trigger) -> None:
        if trigger.token == self._token:
            self.step_limit = max(self.step_limit, trigger.step_limit)
        else:
            self.unauthenticated += 1

    def _take_stop(self, stop: Stop) -> None:
        if stop.token == self._token:
            self._stop = stop
            self._end_if_due(stop)
        else:
            self.unauthenticated += 1

    def _take_call(self, call: Call) -> None:
        if call.token == self._token:
            self.calls.append(call)
        else:
            self.unauthenticated += 1

    def _take_start(self, start: Start) -> None:
        if start.token == self._token:
            self.started = start.inputs
        else:
            self.unauthenticated += 1
