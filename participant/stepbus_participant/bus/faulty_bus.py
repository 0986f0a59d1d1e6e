"""Injected faults, between a participant and its consumers (docs/faults.md)."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from stepbus_schemas import Decoder, Outputs

from .ticket import Endpoint, MessageFault
from .zenoh_bus import ZenohBus

_decode_outputs = Decoder(Outputs)

_PADDING = b"\xa7padding\xc6" + (1 << 20).to_bytes(4, "big") + bytes(1 << 20)
"""An unknown field of 1 MiB, far over what the low-latency transport carries."""


class FaultyBus(ZenohBus):
    """A bus that injects faults into the outputs of one participant.

    name: the participant. faults: what to do at which step. The log to the orchestrator stays
    intact: it reports what was published, not what arrived.
    """

    def __init__(
        self, endpoint: Endpoint, run: str, name: str, faults: Sequence[MessageFault]
    ) -> None:
        super().__init__(endpoint, run)
        self._key = f"out/{name}"
        self._faults = list(faults)

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes, with faults where they are outputs."""
        put = super().publisher(key, encoding, remote=remote)
        return FaultyPublisher(put, self._faults) if key == self._key else put


class FaultyPublisher:
    """Publishes outputs, and injects the faults of their steps.

    Several faults of one step apply one after the other, in their order.
    """

    def __init__(self, put: Callable[..., None], faults: Sequence[MessageFault]) -> None:
        self._put = put
        self._faults: dict[int, list[MessageFault]] = {}
        for fault in faults:
            self._faults.setdefault(fault.step, []).append(fault)
        self._held: list[bytes] = []

    def __call__(self, data: bytes, **more: Any) -> None:
        """Publish the outputs of a step; `more` goes to the bus unchanged."""
        held, self._held = self._held, []
        messages = [data]
        for fault in self._faults.get(_decode_outputs(data).step, ()):
            messages = self._apply(fault, messages)
        for message in (*messages, *held):
            self._put(message, **more)

    def _apply(self, fault: MessageFault, messages: list[bytes]) -> list[bytes]:
        """Return the messages to publish now instead."""
        if fault.type == "drop":
            return []
        if fault.type == "reorder":
            self._held = messages
            return []
        if fault.type == "delay":
            time.sleep(fault.duration_s)
            return messages
        if fault.type == "duplicate":
            return messages * 2
        if fault.type == "corrupt":
            return [_corrupt(message) for message in messages]
        return [_oversize(message) for message in messages]


def _corrupt(message: bytes) -> bytes:
    """Return a message that starts with 0xc1, which MessagePack reserves."""
    return b"\xc1" + message[1:]


def _oversize(message: bytes) -> bytes:
    """Return a message with one more field of 1 MiB, which every reader ignores."""
    return bytes((message[0] + 1,)) + message[1:] + _PADDING
