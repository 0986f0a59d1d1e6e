"""Reads what a program sends with a second codec: what only one understands is no MessagePack."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgpack import ExtType

from stepbus_orchestrator.recording import raw_map
from stepbus_schemas import (
    SHIPPED,
    UNDECODABLE,
    Description,
    MessageError,
    Types,
    encode,
    json_schema,
)


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


Ports = Mapping[str, bytes]
"""Output port → encoded message."""

Feed = Mapping[str, Mapping[int, Ports]]
"""Source → step → what it publishes."""

Edit = Callable[[str, str, int, bytes], bytes]
"""Returns another message for (source, port, step, message)."""


def edited(feed: Feed, edit: Edit) -> Feed:
    """Return a feed with every message replaced by `edit`."""
    return {
        source: {
            step: {port: edit(source, port, step, data) for port, data in ports.items()}
            for step, ports in rows.items()
        }
        for source, rows in feed.items()
    }


def shifted(feed: Feed, ports: set[tuple[str, str]], delay: int) -> Feed:
    """Return a feed in which some ports, as (source, port), come `delay` steps later."""
    return {
        source: {
            step: {
                **{p: data for p, data in row.items() if (source, p) not in ports},
                **{
                    p: data
                    for p, data in rows.get(step - delay, {}).items()
                    if (source, p) in ports
                },
            }
            for step, row in rows.items()
        }
        for source, rows in feed.items()
    }


def repeated(feed: Feed) -> Feed:
    """Return a feed in which a step without a port has the message of the step before."""
    return {source: _filled(rows) for source, rows in feed.items()}


def _filled(rows: Mapping[int, Ports]) -> dict[int, Ports]:
    held: dict[str, bytes] = {}
    filled: dict[int, Ports] = {}
    for step, row in rows.items():
        held = {**held, **row}
        filled[step] = held
    return filled


# --- messages and their vectors --------------------------------------------------------------


def vectors_of(type_name: str, types: Types = SHIPPED) -> set[str]:
    """Return the fields of a message type that have one value for each name."""
    fields = json_schema(type_name, types)["properties"]
    return {name for name, field in fields.items() if field.get("shape") == ["n"]}


def plain(type_name: str, data: bytes, types: Types = SHIPPED) -> dict[str, Any]:
    """Return a message as a map of plain values."""
    message = msgspec.msgpack.decode(data, type=types[type_name])
    fields: dict[str, Any] = msgspec.to_builtins(message)
    return fields


def reverse(type_name: str, data: bytes, types: Types = SHIPPED) -> bytes:
    """Return a message with each of its vectors in reversed order."""
    vectors = vectors_of(type_name, types)
    fields = plain(type_name, data, types)
    turned = {k: v[::-1] if k in vectors and v else v for k, v in fields.items()}
    return encode(msgspec.convert(turned, types[type_name]))


def reverse_description(description: Description) -> Description:
    """Return a description with its names, and all rows that belong to them, reversed."""
    return msgspec.structs.replace(
        description,
        names=description.names[::-1],
        limits={key: row[::-1] for key, row in description.limits.items()},
        details={key: row[::-1] for key, row in description.details.items()},
    )
