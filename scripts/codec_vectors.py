"""The byte vectors of the types that ship, with which any language can test its codec.

For each type: `exact` values with the bytes our encoder makes of them; `accepted` bytes that a
decoder has to take although our encoder would not make them; `refused` bytes, with the path of
what is wrong and a part of the sentence our decoder says. All follow from the types and from the
names and values of the exact vectors, which you write: `minimal`, with the required fields only,
`full`, with all of them, none empty, and what else is worth a vector.
"""

import struct
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
from scripts.refusals import Value, refusals

from stepbus_schemas import PROTOCOL_VERSION, json_schema
from stepbus_schemas.declaration import not_null
from stepbus_schemas.vectors import NOTATION, vector_row

_pack = msgspec.msgpack.Encoder().encode


def vectors(known: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of `schemas/vectors.json`.

    known: the same, of which the names and values of the exact vectors count.
    """
    types = {
        name: _of_type(json_schema(name), {row["name"]: row["value"] for row in groups["exact"]})
        for name, groups in sorted(known["types"].items())
    }
    return {"protocol": PROTOCOL_VERSION, "notation": NOTATION, "types": types}


def _of_type(schema: Value, examples: Mapping[str, Value]) -> dict[str, list[Any]]:
    minimal, full = examples["minimal"], examples["full"]
    return {
        "exact": [vector_row(*example) for example in examples.items()],
        "accepted": list(_accepted(schema, minimal, full)),
        "refused": list(refusals(schema, minimal, full)),
    }


def from_notation(value: dict[str, Any]) -> Any:
    """Return what an object of the JSON of `NOTATION` stands for; for `json.loads`."""
    match value:
        case {"$float": text}:
            return float(text)
        case {"$int": text}:
            return int(text)
        case {"$bin": text}:
            return bytes.fromhex(text)
        case _:
            return value


def _accepted(schema: Value, minimal: Value, full: Value) -> Iterator[dict[str, Any]]:
    """Yield what other encoders and newer versions of a type may send."""
    unknown = {**minimal, "added_later": {"any": ["thing", 1, 2.5, None]}}
    yield vector_row("unknown field", minimal, _pack(unknown))
    reverse = dict(reversed(full.items()))
    yield vector_row("fields in another order", full, _pack(reverse))
    yield vector_row("widest encodings", full, _widest(full))
    fields = schema["properties"].items()
    defaults = {name: field["default"] for name, field in fields if "default" in field}
    if defaults:
        yield vector_row("defaults written out", minimal, _pack({**minimal, **defaults}))
    for name, field in fields:
        if not_null(field).get("items") == {"type": "number"}:
            ones = {**full, name: [1.0, 1.0]}
            yield vector_row(f"{name} as integers", ones, _pack({**full, name: [1, 1]}))
            data = _pack(ones).replace(_pack(1.0), b"\xca" + struct.pack(">f", 1.0))
            yield vector_row(f"{name} as float32", ones, data)


def _widest(value: Any) -> bytes:
    """Return the longest MessagePack of a value."""
    match value:
        case dict():
            items = b"".join(_widest(item) for pair in value.items() for item in pair)
            return b"\xdf" + struct.pack(">I", len(value)) + items
        case list():
            return b"\xdd" + struct.pack(">I", len(value)) + b"".join(map(_widest, value))
        case str():
            return b"\xdb" + struct.pack(">I", len(value.encode())) + value.encode()
        case bytes():
            return b"\xc6" + struct.pack(">I", len(value)) + value
        case int() if not isinstance(value, bool):
            return struct.pack(">Bq", 0xD3, value) if value < 2**63 else _pack(value)
        case _:
            return _pack(value)
