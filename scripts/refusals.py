"""Messages that must be refused, each wrong in one thing, made from what the types say."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from stepbus_schemas.declaration import not_null

Value = dict[str, Any]

_NEVER_USED = b"\xc1"
"""The one byte MessagePack gives no meaning to."""

_pack = msgspec.msgpack.Encoder().encode


class _Wrong(NamedTuple):
    """A value that a field must not have, and the path below the field to what is wrong."""

    reason: str
    value: Any
    place: str = ""
    lacks: str | None = None


def refusals(schema: Value, minimal: Value, full: Value) -> Iterator[dict[str, str]]:
    """Yield what a type's decoder must refuse: name, bytes, path, and a part of the error.

    minimal, full: a value with the required fields, and one with all of them, none empty. The path
    `$` is the whole message, `[...]` any key of a map.
    """
    for reason, data, error in _as_a_whole(minimal):
        yield _row(reason, data, "$", error)
    for name in schema["required"]:
        less = {key: item for key, item in minimal.items() if key != name}
        yield _row(f"$.{name}: missing", _pack(less), f"$.{name}", f"field `{name}`")
    for name, field in schema["properties"].items():
        if field.get("type") == "string" and "contentEncoding" not in field:
            data = _pack({**minimal, name: "12"}).replace(b"\xa212", b"\xa2\xff\xff")
            yield _row(f"$.{name}: no UTF-8", data, f"$.{name}", "utf-8")
        for wrong in _wrong(field, schema.get("$defs", {}), full.get(name)):
            if wrong.value is None and not_null(field) is not field:
                continue
            path = f"$.{name}{wrong.place}"
            error = f"field `{wrong.lacks}`" if wrong.lacks else f"`{path}`"
            data = _pack({**minimal, name: wrong.value})
            yield _row(f"{path}: {wrong.reason}", data, path, error)


def _row(name: str, data: bytes, path: str, error: str) -> dict[str, str]:
    return {"name": name, "hex": data.hex(), "path": path, "error": error}


def _as_a_whole(value: Value) -> Iterator[tuple[str, bytes, str]]:
    yield "nothing", b"", "truncated"
    yield "truncated", _pack({**value, "more": 1.5})[:-1], "truncated"
    yield "trailing bytes", _pack(value) + _pack(None), "trailing"
    # An unused opcode is found whatever the type, in a field that no type has.
    yield "not MessagePack", _pack({**value, "more": None})[:-1] + _NEVER_USED, "malformed"
    yield "nil instead of a map", _pack(None), "Expected `object`"
    yield "number instead of a map", _pack(7), "Expected `object`"
    yield "map inside an array", _pack([value]), "Expected `object`"


_WRONG_SCALARS = {
    "string": [_Wrong("number for a string", 7), _Wrong("binary for a string", b"text")],
    "boolean": [_Wrong("number for a boolean", 1), _Wrong("nil for a boolean", None)],
    "integer": [
        _Wrong("string for an integer", "7"),
        _Wrong("fraction for an integer", 7.5),
        _Wrong("boolean for an integer", True),
    ],
    "number": [
        _Wrong("string for a number", "0.5"),
        _Wrong("array for a number", [0.5]),
        _Wrong("nil for a number", None),
    ],
}


def _wrong(field: Value, types: Value, right: Any) -> Iterator[_Wrong]:
    """Yield what a field must not be; `right` is what it may be."""
    schema = not_null(field)
    if "$ref" in schema:
        schema = types[schema["$ref"].rpartition("/")[2]]
    match schema:
        case {"contentEncoding": _}:
            yield _Wrong("string for binary", "text")
            yield _Wrong("number for binary", 7)
        case {"enum": _}:
            yield _Wrong("not one of its values", "neither")
        case {"type": "array"}:
            yield _Wrong("map for an array", {})
            yield from _wrong_items(schema, types, right)
        case {"type": "object"}:
            yield _Wrong("array for a map", [])
            yield from _wrong_entries(schema, types, right)
        case {"type": scalar}:
            yield from _WRONG_SCALARS[scalar]
            if "minimum" in schema:
                yield _Wrong("below its minimum", schema["minimum"] - 1)


def _wrong_items(schema: Value, types: Value, right: Any) -> Iterator[_Wrong]:
    match schema:
        case {"prefixItems": [*_, item]}:
            before, last = right[:-1], right[-1]
            yield _Wrong("too short", before)
        case {"items": {"$ref": "#/$defs/Outputs"}}:
            # A `Log` carries its `Outputs` undecoded; they are refused later, one by one.
            return
        case {"items": item}:
            before, last = right, right[0]
        case _:
            # The arguments of a call may be anything.
            return
    for wrong in _wrong(item, types, last):
        yield _outward(wrong, [*before, wrong.value], f"[{len(before)}]")


def _wrong_entries(schema: Value, types: Value, right: Any) -> Iterator[_Wrong]:
    if "properties" not in schema:
        entry = schema.get("additionalProperties", {})
        for wrong in _wrong(entry, types, next(iter(right.values()))):
            yield _outward(wrong, {"key": wrong.value}, "[...]")
        return
    for name in schema["required"]:
        less = {key: item for key, item in right.items() if key != name}
        yield _Wrong("missing", less, f".{name}", lacks=name)
    for name in right:
        for wrong in _wrong(schema["properties"][name], types, right[name]):
            yield _outward(wrong, {**right, name: wrong.value}, f".{name}")


def _outward(wrong: _Wrong, value: Any, place: str) -> _Wrong:
    """Return what is wrong, seen from one level further out."""
    return wrong._replace(value=value, place=place + wrong.place)
