"""The inputs of a participant: what is due at a step, what is held, what is refused."""

from __future__ import annotations

from collections import deque
from queue import SimpleQueue
from typing import Any

import msgspec

from stepbus_schemas import (
    HANDSHAKE_STEP,
    Decoder,
    InputConfig,
    Message,
    MessageError,
    Outputs,
    RunError,
    message_class,
)

_decode_outputs = Decoder(Outputs)


class _Signed(msgspec.Struct):
    """The one field that tells a peer's broken message from a stranger's noise."""

    token: str


_decode_signed = msgspec.msgpack.Decoder(_Signed).decode


def carries_token(data: bytes, token: str) -> bool:
    """Return whether broken bytes are at least a map with the run's token."""
    try:
        return _decode_signed(data).token == token
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False


class PeerFault(RunError):
    """Somebody else broke the protocol; `blames` says who."""

    def __init__(self, blames: str, message: str) -> None:
        super().__init__(message)
        self.blames = blames


class Input:
    """One input port: the newest message at or before its due step, held until the next."""

    def __init__(self, name: str, config: InputConfig) -> None:
        self.name = name
        self.config = config
        self.value: Message | None = None
        self.fresh = False
        self._decode = Decoder(message_class(config.type))
        self._pending: deque[tuple[int, Any]] = deque()

    def due(self, step: int) -> int:
        """Return the newest firing of the source at or before `step - delay`; negative: none."""
        reach = step - self.config.delay
        return reach - reach % self.config.every if reach >= 0 else -1

    def offer(self, step: int, data: Any) -> None:
        """Keep what the source published at a step until it is due."""
        self._pending.append((step, data))

    def settle(self, step: int) -> None:
        """Take over the newest message that is due at a step.

        Raises PeerFault when it is not of the port's type.
        """
        self.fresh = False
        pending = self._pending
        if not pending:
            return
        due = self.due(step)
        while pending and pending[0][0] <= due:
            source_step, data = pending.popleft()
            self.fresh = True
            try:
                self.value = self._decode(data)
            except MessageError as exc:
                where = f"{self.config.source}.{self.config.port}"
                raise PeerFault(
                    self.config.source, f"step {source_step}: {where} (input {self.name}): {exc}"
                ) from exc


class Source:
    """One participant we listen to: its `Outputs` in the order of their steps.

    queue: where the bus puts its samples. step: the newest one taken in.
    """

    def __init__(self, name: str, inputs: list[Input], token: str) -> None:
        self.name = name
        self.queue: SimpleQueue[Any] = SimpleQueue()
        self.bulk_queues: dict[str, SimpleQueue[Any]] = {
            item.config.port: SimpleQueue() for item in inputs if item.config.bulk
        }
        self.heard = False
        self.every = inputs[0].config.every
        self.step = -self.every
        self.drops: dict[str, int] = {}
        self._inputs = inputs
        self._token = token
        self._newest = b""
        self._delay = min(item.config.delay for item in inputs)

    def due(self, step: int) -> int:
        """Return the newest step of this source that any input needs at `step`."""
        reach = step - self._delay
        return reach - reach % self.every if reach >= 0 else -1

    def accept(self, data: bytes) -> Outputs | None:
        """Take in one message; return it when it is the next one, None when it was dropped.

        Raises PeerFault when it is malformed, contradicts an earlier one or skips a step.
        """
        try:
            outputs = _decode_outputs(data)
        except MessageError as exc:
            if not carries_token(data, self._token):
                self.drop("malformed")
                return None
            raise PeerFault(self.name, f"after step {self.step}: {self.name} sent {exc}") from exc
        if outputs.token != self._token:
            self.drop("unauthenticated")
            return None
        if outputs.step == HANDSHAKE_STEP:
            self.heard = True
            return None
        if outputs.step != self.step + self.every:
            self._out_of_order(outputs, data)
            return None
        self.step = outputs.step
        self._newest = data
        self._hand_over(outputs)
        return outputs

    def _hand_over(self, outputs: Outputs) -> None:
        for item in self._inputs:
            data = outputs.ports.get(item.config.port)
            if data is not None:
                item.offer(outputs.step, data)

    def take_bulk(self, outputs: Outputs, port: str, content: bytes) -> None:
        """Hand the content of a bulk port to the inputs that take it."""
        for item in self._inputs:
            if item.config.port == port:
                item.offer(outputs.step, content)

    def _out_of_order(self, outputs: Outputs, data: bytes) -> None:
        if outputs.step > self.step:
            raise PeerFault(
                self.name,
                f"{self.name} skipped from step {self.step} to {outputs.step} "
                f"(expected {self.step + self.every}); was a message lost or reordered?",
            )
        if outputs.step == self.step and data != self._newest:
            raise PeerFault(
                self.name, f"{self.name} published step {self.step} twice with different content"
            )
        self.drop("duplicate" if outputs.step == self.step else "stale")

    def drop(self, cause: str) -> None:
        """Count a message that is not taken."""
        self.drops[cause] = self.drops.get(cause, 0) + 1


def make_inputs(configs: dict[str, InputConfig]) -> dict[str, Input]:
    """Return the inputs of a participant by name.

    Raises WiringError for an unknown message type.
    """
    return {name: Input(name, config) for name, config in configs.items()}


def make_sources(inputs: dict[str, Input], token: str) -> list[Source]:
    """Return one source per participant we listen to, in the order of the inputs."""
    by_source: dict[str, list[Input]] = {}
    for item in inputs.values():
        by_source.setdefault(item.config.source, []).append(item)
    return [Source(name, items, token) for name, items in by_source.items()]
