"""What a participant receives: its inputs, and the messages of others that feed them."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from queue import SimpleQueue
from typing import Any

import msgspec

from stepbus_participant.bus import Queue
from stepbus_participant.bus.slots import SlotContent, SlotError
from stepbus_schemas import (
    HANDSHAKE_STEP,
    SHIPPED,
    UNDECODABLE,
    Batch,
    Decoder,
    InputConfig,
    Message,
    Outputs,
    RunError,
    Types,
    WiringError,
    encode,
    reached,
    type_name,
)


class PeerFault(RunError):
    """Another participant broke the protocol; `blames` names it."""

    def __init__(self, blames: str, message: str) -> None:
        super().__init__(message)
        self.blames = blames


class Input:
    """One input port: it holds its newest due message until the next one is due (P6.3).

    types: with those that do not ship. Raises WiringError for an unknown message type.

    value: that message; None while the input is absent. fresh: whether it is new at this step.
    pending: what the source published, (step, bytes), until it is due (P6.2).
    """

    def __init__(self, name: str, config: InputConfig, types: Types = SHIPPED) -> None:
        self.name = name
        self.config = config
        self.value: Message | None = None
        self.fresh = False
        self.pending: deque[tuple[int, Any]] = deque()
        self._delay = config.delay
        self._is_bulk = config.bulk
        self._cls = types[config.type]
        self._decoder = Decoder(self._cls)
        self._decode = self._decoder.plain

    def read_as(self, cls: type[Message]) -> Message | None:
        """Return the message as a class of the input's type, and take all further ones as that.

        Such as `SensedJoints`, which requires more fields. Raises MessageError where one is
        missing, WiringError for another type.
        """
        if isinstance(self.value, cls | None):
            return self.value
        if type_name(cls) != self.config.type or not issubclass(cls, self._cls):
            raise WiringError(
                f"input {self.name!r} is read as {cls.__name__}, but the scenario connects "
                f"{self.config.type}"
            )
        self._decoder = Decoder(cls, f"{self.config.type} as {cls.__name__} requires it")
        self._decode = self._decoder.plain
        self.value = self._decoder(encode(self.value))
        return self.value

    def restore(self, held: bytes | None, pending: Iterable[tuple[int, bytes]]) -> None:
        """Hold a message, as saved at a checkpoint; raises MessageError for one of another type."""
        self.value = None if held is None else self._decoder(held)
        # The same queue: the source fills it.
        self.pending.clear()
        self.pending.extend(pending)

    def settle(self, step: int) -> None:
        """Take the newest message that is due at a step.

        Raises PeerFault when it is not of the port's type (P8.2).
        """
        self.fresh = False
        # Its steps are multiples of its period, so that those up to here are due (`due_step`).
        pending, reach = self.pending, step - self._delay
        while pending and pending[0][0] <= reach:
            source_step, data = pending.popleft()
            self.fresh = True
            try:
                in_slot = self._is_bulk and isinstance(data, SlotContent)
                self.value = self._from_slot(data) if in_slot else self._decode(data)
            except SlotError as exc:
                where = f"{self.config.source}.{self.config.port}"
                raise PeerFault(self.config.source, f"step {source_step}: {where}: {exc}") from exc
            except UNDECODABLE as exc:
                where = f"{self.config.source}.{self.config.port} (input {self.name})"
                reached("a message of a source is not of its type")
                error = self._decoder.error(exc)
                raise PeerFault(
                    self.config.source, f"step {source_step}: {where}: {error}"
                ) from error

    def _from_slot(self, content: SlotContent) -> Message:
        """Return a message that lasts longer than its slot."""
        if self._decoder.makes_views:
            return self._decode(bytes(content))
        return content.decoded(self._decode)


_decode_outputs = Decoder(Outputs)
_decode_batch = Decoder(Batch)


class _Signed(msgspec.Struct):
    """The one field that distinguishes a broken message of a peer from noise."""

    token: str


_decode_signed = msgspec.msgpack.Decoder(_Signed).decode


def carries_token(data: bytes | msgspec.Raw, token: str) -> bool:
    """Return whether malformed bytes are at least a map with the run's token (P8.1)."""
    try:
        return _decode_signed(data).token == token
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False


class Source:
    """One participant to read from: its `Outputs` in the order of their steps.

    queue: where the bus puts the content of its samples. entries: messages that come before all in
    the queue: the rest of a `Batch`, or one that was taken before its step. step: the newest step
    accepted; `-every`: none yet, as of `due_step`. delay: the least of any input [steps].
    connected: whether a handshake has arrived. drops: cause → number of dropped messages, of all
    sources.
    """

    def __init__(
        self,
        name: str,
        inputs: list[Input],
        token: str,
        make_queue: Callable[[], Queue],
        drops: dict[str, int],
    ) -> None:
        self.name = name
        self.queue = make_queue()
        self.entries: deque[bytes | msgspec.Raw] = deque()
        self.bulk_queues: dict[str, Queue] = {
            item.config.port: make_queue() for item in inputs if item.config.bulk
        }
        self.connected = False
        self.every = inputs[0].config.every
        self.step = -self.every
        self.drops = drops
        self._inputs = inputs
        self._pending = [(item.config.port, item.pending) for item in inputs]
        self._token = token
        self._newest: bytes | msgspec.Raw = b""
        self._restored: float = -math.inf
        self.delay = min(item.config.delay for item in inputs)

    def due(self, step: int) -> int:
        """Return the newest step of this source that any input needs at `step`."""
        reach = step - self.delay
        return reach - reach % self.every

    def is_awaited(self, step: int) -> bool:
        """Return whether the queue has to bring the next message that `step` needs."""
        return not self.entries and self.step < self.due(step)

    def accept(self, data: bytes | msgspec.Raw) -> Outputs | None:
        """Check one message against P8.1; return it when it is the next one.

        None: it was dropped, or a `Batch`, whose entries are now to be accepted one by one.
        Raises PeerFault when it is malformed, contradicts an earlier one or skips a step.
        """
        try:
            outputs = _decode_outputs.plain(data)
        except UNDECODABLE as exc:
            if isinstance(data, bytes) and self._open(data):
                return None
            if not carries_token(data, self._token):
                self.drop("malformed")
                return None
            reached("the outputs of a source are malformed")
            error = _decode_outputs.error(exc)
            raise PeerFault(
                self.name, f"after step {self.step}: {self.name} sent {error}"
            ) from error
        if outputs.token != self._token:
            self.drop("unauthenticated")
            return None
        if outputs.step == HANDSHAKE_STEP:
            self.connected = True
            return None
        if outputs.step != self.step + self.every:
            self._drop_or_blame(outputs, data)
            return None
        self.step = outputs.step
        self._newest = data
        ports = outputs.ports
        for port, pending in self._pending:
            if port in ports:
                pending.append((self.step, ports[port]))
        return outputs

    def _open(self, data: bytes) -> bool:
        """Take the entries of a message that is a `Batch` (P7.6); return whether it is one."""
        try:
            batch = _decode_batch.plain(data)
        except UNDECODABLE:
            return False
        if batch.token == self._token:
            self.entries.extend(batch.outputs)
        else:
            self.drop("unauthenticated")
        return True

    def offer_bulk(self, outputs: Outputs, port: str, content: bytes | SlotContent) -> None:
        """Offer the content of a bulk port to the inputs that read it."""
        for item in self._inputs:
            if item.config.port == port:
                item.pending.append((outputs.step, content))

    def continue_after(self, step: int) -> None:
        """Skip all up to a step: a checkpoint has what is needed of it (P16.3)."""
        self.step = step
        self._restored = step

    def _drop_or_blame(self, outputs: Outputs, data: bytes | msgspec.Raw) -> None:
        if outputs.step <= self._restored:
            return
        if outputs.step > self.step:
            reached("a source skips a step")
            raise PeerFault(
                self.name,
                f"{self.name} skipped from step {self.step} to {outputs.step} "
                f"(expected {self.step + self.every}); was a message lost or reordered?",
            )
        if outputs.step == self.step and bytes(data) != bytes(self._newest):
            reached("a source publishes a step twice, otherwise")
            raise PeerFault(
                self.name, f"{self.name} published step {self.step} twice with different content"
            )
        reached("a message that comes again is dropped")
        self.drop("duplicate" if outputs.step == self.step else "stale")

    def drop(self, cause: str) -> None:
        """Count a dropped message."""
        self.drops[cause] = self.drops.get(cause, 0) + 1


def make_sources(
    inputs: Mapping[str, Input],
    token: str,
    make_queue: Callable[[], Queue] = SimpleQueue,
    drops: dict[str, int] | None = None,
) -> list[Source]:
    """Return one source per participant that the inputs read from, in the order of the inputs.

    make_queue: of their samples, as the bus needs it. drops: where they count dropped messages.
    """
    by_source: dict[str, list[Input]] = {}
    for item in inputs.values():
        by_source.setdefault(item.config.source, []).append(item)
    counts = {} if drops is None else drops
    return [Source(name, items, token, make_queue, counts) for name, items in by_source.items()]
