"""Values of a declared type, from which its byte vectors are made."""

import math
from collections.abc import Mapping
from typing import Any

Schema = Mapping[str, Any]
_ODD = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf, "minus zero": -0.0}
_TEXT = "\u0301e · 左腕 · \U0001f9be · \n\"'"
_BYTES = b"\xff\xc1\x00"


def examples(schema: Schema) -> list[dict[str, Any]]:
    """Return `name` and `value` of the exact vectors of a type.

    `minimal`, with the required fields only; `full`, with all of them, none empty or as by
    default; and one with each odd float.
    """
    fields = schema["properties"]
    required = {name: _least(_inner(fields[name])) for name in schema.get("required", [])}
    full = {name: _other(node) for name, node in fields.items()}
    full = {name: value for name, value in full.items() if value is not None}
    rows = [{"name": "minimal", "value": required}, {"name": "full", "value": full}]
    return rows + [
        {"name": name, "value": value}
        for name, odd in _ODD.items()
        if repr(value := _with(full, odd)) != repr(full)
    ]


def _inner(node: Schema) -> Schema:
    return next((item for item in node.get("anyOf", []) if item != {"type": "null"}), node)


def _least(node: Schema) -> Any:
    """Return the smallest value of a type."""
    match node:
        case {"enum": words}:
            return words[0]
        case {"contentEncoding": _}:
            return b""
        case {"prefixItems": items}:
            return [_least(item) for item in items]
        case {"type": "array"}:
            return []
        case {"type": scalar}:
            least = {"number": 0.0, "integer": node.get("minimum", 0), "boolean": False}
            return least.get(scalar, "")
    return None


def _other(node: Schema) -> Any:
    """Return a value that is neither empty nor the default; None where there is none."""
    inner = _inner(node)
    options = [*inner["enum"]] if "enum" in inner else [_filled(inner, 1), _filled(inner, 2)]
    return next((value for value in options if value != node.get("default")), None)


def _filled(node: Schema, number: int) -> Any:
    """Return a value that is not empty; another number, another value."""
    if "enum" in node:
        return node["enum"][-1]
    if "contentEncoding" in node:
        return _BYTES * number
    if node.get("type") == "array":
        items = node.get("prefixItems") or [node["items"]] * 2
        return [_filled(item, number + i) for i, item in enumerate(items)]
    values = {
        "number": number + 0.5,
        "integer": int(node.get("minimum", 0)) + number,
        "boolean": number == 1,
    }
    return values.get(str(node.get("type")), _TEXT * number)


def _with(value: Any, odd: float) -> Any:
    """Return a value with an odd number for each float."""
    match value:
        case dict():
            return {key: _with(item, odd) for key, item in value.items()}
        case list():
            return [_with(item, odd) for item in value]
        case float():
            return odd
    return value
