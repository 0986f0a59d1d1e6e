"""A message as a plain map, by msgpack: a codec that shares no line with the one that wrote it."""

from typing import Any

import msgpack

from stepbus_schemas import MessageError

_UTC = 3
"""How msgpack gives timestamps: as datetime."""


def raw_map(data: bytes) -> dict[str, Any]:
    """Return the fields of a message as they stand in its bytes; defaults are left out.

    Raises MessageError for bytes that are not one MessagePack map.
    """
    try:
        found = msgpack.unpackb(data, strict_map_key=False, timestamp=_UTC)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as exc:
        raise MessageError(f"no MessagePack: {str(exc) or type(exc).__name__}") from exc
    if not isinstance(found, dict):
        raise MessageError(f"no MessagePack map: {type(found).__name__}")
    return found
