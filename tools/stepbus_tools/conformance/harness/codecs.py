"""Reads what a program sends with a second codec: what only one understands is no MessagePack."""

from typing import Any

import msgspec
from msgpack import ExtType

from stepbus_orchestrator.recording import raw_map
from stepbus_schemas import UNDECODABLE, MessageError


def _extension(code: int, data: memoryview) -> Any:
    return ExtType(code, bytes(data))


_decode = msgspec.msgpack.Decoder(ext_hook=_extension).decode


def disagreement(data: bytes) -> str:
    """Return how msgpack and msgspec differ in what they make of a message; empty: they agree."""
    try:
        theirs = raw_map(data)
    except MessageError as exc:
        return f"msgpack reads {exc}"
    try:
        ours = _decode(data)
    except UNDECODABLE as exc:
        return f"msgspec reads no MessagePack: {exc}"
    # As text: NaN equals NaN there, 1 is not 1.0, and the order of the fields counts.
    different = [name for name in theirs if repr(theirs[name]) != repr(ours.get(name))]
    return f"msgpack and msgspec read {different[0]!r} differently" if different else ""
