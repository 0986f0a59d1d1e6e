"""Recordings of earlier protocol numbers: their messages in the names of today.

A new number that renames fields of what is recorded adds them here (docs/protocol.md, "Changes").
"""

from collections.abc import Callable, Mapping
from typing import TypeVar

import msgspec

from stepbus_schemas import Decoder, Envelope, Message, type_name

T = TypeVar("T", bound=Message | Envelope)

_RENAMED: Mapping[str, Mapping[str, str]] = {
    "CallRecord/1": {"verb": "method"},
    "Detections/1": {"kinds": "types"},
    "Goal/1": {"kind": "type"},
}
"""Type → name of a field in protocol 1 → its name since."""
_fields = msgspec.msgpack.Decoder(dict[str, msgspec.Raw]).decode
_encode = msgspec.msgpack.Encoder().encode


def upgraded(type_name: str) -> Callable[[bytes], bytes]:
    """Return what gives a recorded message of a type in the names of today."""
    renamed = _RENAMED.get(type_name)

    def upgrade(data: bytes) -> bytes:
        if renamed is None:
            return data
        try:
            fields = _fields(data)
        except msgspec.MsgspecError:
            return data
        if renamed.keys().isdisjoint(fields):
            return data
        return _encode({renamed.get(name, name): value for name, value in fields.items()})

    return upgrade


def recorded_decoder(cls: type[T]) -> Callable[[bytes], T]:
    """Return the decoder of a type for messages of recordings; it raises as `Decoder`."""
    decode, upgrade = Decoder(cls), upgraded(type_name(cls))
    return lambda data: decode(upgrade(data))
