"""What the orchestrator sends to a participant: start, trigger, stop and calls."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from queue import Empty

from stepbus_participant.bus import Bus, Queue
from stepbus_schemas import Call, Decoder, Description, MessageError, RunError, Start, Stop, Trigger

_DECODERS: Mapping[str, Callable[[bytes], Start | Trigger | Stop | Call]] = {
    "start": Decoder(Start),
    "trigger": Decoder(Trigger),
    "stop": Decoder(Stop),
    "call": Decoder(Call),
}
_LOST = "lost"
_NOT_URGENT = ("trigger", "call")
"""A participant that waits for an input need not wake up for these."""


class Stopped(Exception):
    """The orchestrator ended the run."""

    def __init__(self, stop: Stop) -> None:
        super().__init__(stop.reason)
        self.stop = stop


class OrchestratorLost(RunError, ConnectionError):
    """The orchestrator died, or the link to it broke."""


class Control:
    """The orchestrator's newest orders.

    step_limit: the first step not yet released. started: participant → input → description, once
    the run has started. batches: participant → how many steps it may publish at once. calls: calls
    to answer while waiting for the trigger; only with `name`.
    unauthenticated: messages dropped, since malformed or without the run's token (P8.4).

    A stop can overtake the last inputs, which arrive over other links. So it takes effect when
    `enter` reaches its step: what is published before that step belongs to the run (P11.2).
    """

    def __init__(self, bus: Bus, token: str, wake: Iterable[Queue], name: str = "") -> None:
        self.step_limit = 0
        self.calls: deque[Call] = deque()
        self.started: Mapping[str, Mapping[str, Description]] | None = None
        self.batches: Mapping[str, int] = {}
        self.unauthenticated = 0
        self._token = token
        self._step = -1
        self._stop: Stop | None = None
        self._wake = list(wake)
        self._queue = bus.queue()
        for key in ("start", "trigger", "stop"):
            bus.subscribe_content(key, self._sink(key))
        if name:
            bus.subscribe_content(f"call/{name}", self._sink("call"))
        bus.watch_alive("alive/orchestrator", self._on_alive)

    def _sink(self, key: str) -> Callable[[bytes], None]:
        return lambda data: self._put(key, data)

    def _on_alive(self, _key: str, alive: bool) -> None:
        if not alive:
            self._put(_LOST, b"")

    def _put(self, key: str, data: bytes) -> None:
        """Queue a message, and wake a participant that waits for an input."""
        self._queue.put((key, data))
        if key not in _NOT_URGENT:
            for queue in self._wake:
                queue.put(None)

    def enter(self, step: int) -> None:
        """Start a step; raises Stopped when the run ends before it."""
        self._step = step
        if self._stop is not None:
            self._end_if_due(self._stop)

    def _end_if_due(self, stop: Stop) -> None:
        # A negative `at_step` ends the run wherever it is (P11.1).
        if self._step >= stop.at_step:
            raise Stopped(stop)

    def wait(self, timeout_s: float) -> bool:
        """Process the next message; return whether one arrived in time.

        Raises Stopped when the run ends, OrchestratorLost when the orchestrator has died.
        """
        try:
            key, data = self._queue.get(timeout=timeout_s)
        except Empty:
            return False
        self._process(key, data)
        return True

    def poll(self) -> None:
        """Process the messages that have arrived; raises as `wait` does."""
        for _ in range(self._queue.qsize()):
            self._process(*self._queue.get())  # no time-out: it is not empty

    def _process(self, key: str, data: bytes) -> None:
        if key == _LOST:
            raise OrchestratorLost("lost the orchestrator; this participant ends too")
        try:
            message = _DECODERS[key](data)
        except MessageError:
            self.unauthenticated += 1
            return
        if message.token != self._token:
            self.unauthenticated += 1
            return
        self._accept(message)

    def _accept(self, message: Start | Trigger | Stop | Call) -> None:
        match message:
            case Trigger():
                # Triggers may repeat, arrive late or skip numbers (P5.2).
                self.step_limit = max(self.step_limit, message.step_limit)
            case Stop():
                self._stop = message
                self._end_if_due(message)
            case Call():
                self.calls.append(message)
            case Start():
                self.started, self.batches = message.inputs, message.batches
