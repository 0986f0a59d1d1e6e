"""Injected faults, between a participant and its consumers (docs/faults.md)."""

from collections.abc import Callable, Sequence
from typing import Any

from stepbus_participant.bus import Clock
from stepbus_participant.bus.ticket import MessageFault
from stepbus_schemas import Decoder, Outputs

_decode_outputs = Decoder(Outputs)

_PADDING = b"\xa7padding\xc6" + (1 << 20).to_bytes(4, "big") + bytes(1 << 20)
"""An unknown field of 1 MiB, far over what the low-latency transport carries."""


class FaultyPublisher:
    """Publishes outputs, and injects the faults of their steps.

    Several faults of one step apply one after the other, in their order. What the log reports was
    published, not what arrived.
    """

    def __init__(
        self, put: Callable[..., None], faults: Sequence[MessageFault], clock: Clock
    ) -> None:
        self._put = put
        self._clock = clock
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
        match fault.type:
            case "drop":
                return []
            case "reorder":
                self._held = messages
                return []
            case "delay":
                self._clock.sleep(fault.duration_s)
                return messages
            case "duplicate":
                return messages * 2
            case "corrupt":
                # MessagePack reserves 0xc1.
                return [b"\xc1" + message[1:] for message in messages]
        # One more field, which every reader ignores.
        return [bytes((message[0] + 1,)) + message[1:] + _PADDING for message in messages]
