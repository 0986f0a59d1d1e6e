"""Markdown tables of the message types, for people."""

from collections.abc import Iterable, Sequence
from typing import Any

from .bridge import raw_fields
from .catalogue import SHIPPED, Types
from .declaration import not_null
from .messages import MESSAGE_TYPES
from .protocol import ENVELOPE_TYPES
from .schema import json_schema

_HEADER = "<!-- Written by `python -m scripts.generate_messages`; do not edit. -->"

_INTRODUCTION = """\
# Messages

Every message is a MessagePack map with the fields below. Units are SI. A vector of shape (n,) has
one entry per name in its port's description, in that order. Optional fields may be omitted.
Unknown fields are ignored; missing or mistyped fields are rejected. Integers are MessagePack
integers; a float may also come as a float32 or as an integer.

A scenario may declare [its own types](../guide/writing/message_types.md).

Machine-readable files: JSON Schema in `schemas/json/`, byte vectors for your codec in
`schemas/vectors.json` (its `notation` explains how to read them).
"""


def messages_page() -> str:
    """Return the content of `docs/reference/messages.md`."""
    parts = [_HEADER, _INTRODUCTION, "## Port messages\n", port_table(), "## Protocol envelopes\n"]
    nested: dict[str, Any] = {}
    for type_name in ENVELOPE_TYPES:
        schema = json_schema(type_name)
        nested |= schema.get("$defs", {})
        parts.append(_section(type_name, schema))
    parts.append("## Parts of envelopes\n")
    shared = (name for name in sorted(nested) if f"{name}/1" not in ENVELOPE_TYPES)
    parts += [_section(name, nested[name]) for name in shared]
    return "\n".join(parts)


def port_table(names: Iterable[str] = MESSAGE_TYPES, types: Types = SHIPPED) -> str:
    """Return the table of port types: type, field, value, unit, shape, meaning."""
    rows = []
    for type_name in names:
        label = f"`{type_name}`"
        for name, field in json_schema(type_name, types)["properties"].items():
            value = f"{_type_text(field)}, optional" if "default" in field else _type_text(field)
            unit, sizes = field.get("unit", ""), field.get("shape", [])
            # As Python writes a tuple.
            shape = f"({', '.join(sizes)}{',' * (len(sizes) == 1)})" if sizes else ""
            rows.append([label, f"`{name}`", value, unit, shape, field["description"]])
            label = ""
    return _table(["Type", "Field", "Value", "Unit", "Shape", "Meaning"], rows)


def types_page(names: Sequence[str], types: Types) -> str:
    """Return the table of some types, and what they are in numbers, in format raw of the bridge."""
    numbers = [
        [f"`{name}`", ", ".join(map(str, raw_fields(name, types))) or "not only numbers"]
        for name in names
    ]
    raw = _table(["Type", "Numbers in format `raw`"], numbers)
    return f"{port_table(names, types)}\n## Format raw\n\n{raw}"


def _section(name: str, schema: dict[str, Any]) -> str:
    rows = []
    for field, row in schema["properties"].items():
        default = "required" if field in schema["required"] else _default(row)
        rows.append([f"`{field}`", _type_text(row), default, row["description"]])
    table = _table(["Field", "Value", "Default", "Meaning"], rows)
    return f"### {name}\n\n{schema['description']}\n\n{table}"


def _table(head: list[str], rows: Iterable[list[str]]) -> str:
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return "\n".join([lines[0], f"|{'---|' * len(head)}", *lines[1:]]) + "\n"


def _default(field: dict[str, Any]) -> str:
    match field["default"]:
        case None:
            return "absent"
        case "" | [] | {}:
            return "empty"
        case bool() as flag:
            return str(flag).lower()
        case value:
            return str(value)


def _type_text(schema: dict[str, Any]) -> str:
    """Return what a field holds, in words."""
    match not_null(schema):
        case {"$ref": reference}:
            return str(reference).rpartition("/")[2]
        case {"type": "array", "prefixItems": items}:
            return f"({', '.join(map(_type_text, items))})"
        case {"type": "array", "items": item}:
            return f"list of {_type_text(item)}"
        case {"type": "object", "additionalProperties": item}:
            return f"map to {_type_text(item)}"
        case scalar:
            return _scalar(scalar, schema)


def _scalar(inner: dict[str, Any], schema: dict[str, Any]) -> str:
    match inner:
        case {"contentEncoding": _}:
            return "binary"
        case {"enum": values}:
            return ", ".join(f"`{value}`" for value in schema.get("words", values))
        case {"type": "integer", "minimum": least}:
            return f"integer ≥ {least}"
        case {"type": "number"}:
            return "float"
        case {"type": "object"}:
            return "map"
        case _:
            return str(inner.get("type", "any value"))
