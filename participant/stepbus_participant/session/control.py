"""What the orchestrator sends to a participant: triggers, calls, the end; and its answers."""

import contextlib
import inspect
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from queue import Empty
from typing import Any

import msgspec

from stepbus_participant.bus import Bus, Queue
from stepbus_participant.calls import Method
from stepbus_schemas import (
    Call,
    Called,
    Decoder,
    MessageError,
    RunError,
    Start,
    StepbusError,
    Stop,
    Trigger,
    Welcome,
    encode,
    encoding_of,
    explained,
    reached,
    text_of,
)

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


def watched_orders(bus: Bus) -> Queue:
    """Return a queue for the orchestrator's orders, which shows its death from now on (P4.4).

    From before a participant asks to join: one that looked after its `Welcome` would wait for ever,
    had the orchestrator died in between.
    """
    orders = bus.queue()

    def on_alive(_key: str, alive: bool) -> None:
        if not alive:
            orders.put((_LOST, b""))

    bus.watch_alive("alive/orchestrator", on_alive)
    return orders


class Control:
    """The orchestrator's newest orders, and the answers to its calls.

    orders: as of `watched_orders`. wake: wake a participant that waits for an input. drops:
    cause → number of dropped messages, of those that are malformed or without the run's token
    (P8.4). step_limit: the first step not yet released. step: which is worked on. stop: how the run
    ends, once that is known. started: once the run has started. calls:
    those to answer while waiting for the trigger. methods: that can be called, by name.

    A stop can overtake the last inputs, which arrive over other links. So it takes effect when
    `enter` reaches its step: what is published before that step belongs to the run (P11.2).
    """

    def __init__(
        self,
        bus: Bus,
        welcome: Welcome,
        orders: Queue,
        wake: Iterable[Callable[[Any], object]],
        drops: dict[str, int],
    ) -> None:
        self.step_limit = 0
        self.started: Start | None = None
        self.methods: Mapping[str, Method] = {}
        self._welcome = welcome
        self._token = welcome.token
        self._drops = drops
        self.step = -1
        self.stop: Stop | None = None
        self.calls: deque[Call] = deque()
        self._newest_id, self._newest_answer = -1, b""
        self._put_answer = bus.publisher(f"called/{welcome.name}", encoding_of("Called/1"))
        self._wake = list(wake)
        self._queue = orders
        for key in _DECODERS:
            where = f"call/{welcome.name}" if key == "call" else key
            bus.subscribe_content(where, partial(self._put, key))

    def _put(self, key: str, data: bytes) -> None:
        """Queue a message, and wake a participant that waits for an input."""
        self._queue.put((key, data))
        if key not in _NOT_URGENT:
            for wake in self._wake:
                wake(None)

    def enter(self, step: int) -> None:
        """Start a step; raises Stopped when the run ends before it."""
        self.step = step
        if self.stop is not None:
            self._end_if_due(self.stop)

    def _end_if_due(self, stop: Stop) -> None:
        # A negative `at_step` ends the run wherever it is (P11.1).
        if self.step >= stop.at_step:
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
            reached("the orchestrator is lost")
            raise OrchestratorLost(
                "lost the connection to the orchestrator; this participant exits"
            )
        try:
            message: Start | Trigger | Stop | Call | None = _DECODERS[key](data)
        except MessageError:
            message = None
        if message is None or message.token != self._token:
            reached("an order of another run is dropped")
            self._drops["unauthenticated"] = self._drops.get("unauthenticated", 0) + 1
            return
        match message:
            case Trigger():
                # Triggers may repeat, arrive late or skip numbers (P5.2).
                self.step_limit = max(self.step_limit, message.step_limit)
            case Stop():
                self.stop = message
                self._end_if_due(message)
            case Call():
                self.calls.append(message)
            case Start():
                self.started = message

    def answer_calls(self) -> None:
        """Answer each call once; a repeated call gets the same answer (P15.3).

        The orchestrator releases no step before the call is answered, so a call always happens
        between the same two steps (P15.2).
        """
        while self.calls:
            call = self.calls.popleft()
            if call.id > self._newest_id:
                self._newest_id, self._newest_answer = call.id, self._answer(call)
            if call.id == self._newest_id:
                self._put_answer(self._newest_answer)

    def _answer(self, call: Call) -> bytes:
        method = self.methods.get(call.method)
        if method is None:
            known = ", ".join(self.methods) or "nothing"
            text = f"unknown method {call.method!r}; {self._welcome.name} offers {known}"
            return self._pack(call, error=text)
        try:
            # Some built-in functions do not reveal their parameters.
            with contextlib.suppress(ValueError):
                inspect.signature(method.function).bind(*call.args)
            value = method.function(*call.args)
        except (ArithmeticError, LookupError, StepbusError, TypeError, ValueError) as exc:
            return self._pack(call, error=f"{call.method}: {text_of(exc)}")
        try:
            return self._pack(call, value=value)
        except (OverflowError, TypeError, ValueError) as exc:
            return self._pack(call, error=f"{call.method}: the return value: {explained(exc)}")

    def _pack(self, call: Call, value: Any = None, error: str | None = None) -> bytes:
        name, limit = self._welcome.name, self._welcome.max_outputs_bytes
        answer = Called(name=name, token=self._token, id=call.id, value=value, error=error)
        data = encode(answer)
        if len(data) <= limit:
            return data
        # The bus would lose it silently, and the run would wait in vain (P3.7).
        why = (
            f"{call.method[:100]}: the answer has {len(data)} bytes, the low-latency transport "
            f"carries at most {limit}; set bus.low_latency: false"
        )
        return encode(msgspec.structs.replace(answer, value=None, error=why))
