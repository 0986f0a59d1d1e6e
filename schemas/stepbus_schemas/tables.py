"""Markdown tables of the message types, for people."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from stepbus_schemas.bridge import raw_fields
from stepbus_schemas.messages import MESSAGE_TYPES
from stepbus_schemas.protocol import ENVELOPE_TYPES
from stepbus_schemas.schema import json_schema, not_null
from stepbus_schemas.types import SHIPPED, Types

_HEADER = "<!-- Written by `python -m stepbus_schemas.generate`; do not edit. -->"

_INTRODUCTION = """\
# Messages

Every message is a MessagePack map with the fields below. Units are SI. A vector of shape (n,) has
one entry per name of its port's description, in that order. Optional fields may be left out.
Unknown fields are ignored; a missing or mistyped one is refused. Integers are MessagePack integers;
a float may also come as a float32 or as an integer.

A scenario may bring [types of its own](../guide/writing/message_types.md).

Machine-readable: JSON Schema in `schemas/json/`, byte vectors for your codec in
`schemas/vectors.json` (its `notation` says how to read it).
"""


def messages_page() -> str:
    """Return the content of `docs/reference/messages.md`."""
    parts = [_HEADER, _INTRODUCTION, "## Port messages\n", port_table(), "## Protocol envelopes\n"]
    parts += [_envelope_section(name) for name in ENVELOPE_TYPES]
    parts += ["## Parts of envelopes\n", *_shared_sections()]
    return "\n".join(parts)


def port_table(names: Iterable[str] = MESSAGE_TYPES, types: Types = SHIPPED) -> str:
    """Return the table of port types: type, field, value, unit, shape, meaning."""
    rows = ["| Type | Field | Value | Unit | Shape | Meaning |", "|---|---|---|---|---|---|"]
    for type_name in names:
        rows += _port_rows(json_schema(type_name, types), type_name)
    return "\n".join(rows) + "\n"


def types_page(names: Sequence[str], types: Types) -> str:
    """Return the table of some types, and their numbers in format raw of the bridge."""
    return f"{port_table(names, types)}\n## Format raw\n\n{raw_table(names, types)}"


def raw_table(names: Iterable[str], types: Types = SHIPPED) -> str:
    """Return the table of what types are in numbers, in the order of the numbers."""
    rows = ["| Type | Numbers in format `raw` |", "|---|---|"]
    for name in names:
        fields = raw_fields(name, types)
        rows.append(_row([f"`{name}`", ", ".join(map(str, fields)) or "no numbers alone"]))
    return "\n".join(rows) + "\n"


def _port_rows(schema: dict[str, Any], type_name: str) -> Iterator[str]:
    label = f"`{type_name}`"
    for name, field in schema["properties"].items():
        shape = _shape(field["shape"]) if "shape" in field else ""
        value = f"{_type_text(field)}, optional" if "default" in field else _type_text(field)
        unit = field.get("unit", "")
        yield _row([label, f"`{name}`", value, unit, shape, field["description"]])
        label = ""


def _shape(sizes: list[str]) -> str:
    """Return a shape as Python writes a tuple."""
    return f"({sizes[0]},)" if len(sizes) == 1 else f"({', '.join(sizes)})"


def _envelope_section(type_name: str) -> str:
    schema = json_schema(type_name)
    return f"### {type_name}\n\n{schema['description']}\n\n{_field_table(schema)}"


def _shared_sections() -> Iterator[str]:
    """Yield what is nested in envelopes and no envelope itself, each once, by name."""
    nested: dict[str, Any] = {}
    for type_name in ENVELOPE_TYPES:
        nested |= json_schema(type_name).get("$defs", {})
    for name in sorted(nested):
        if f"{name}/1" not in ENVELOPE_TYPES:
            schema = nested[name]
            yield f"### {name}\n\n{schema['description']}\n\n{_field_table(schema)}"


def _field_table(schema: dict[str, Any]) -> str:
    rows = ["| Field | Value | Default | Meaning |", "|---|---|---|---|"]
    for name, field in schema["properties"].items():
        default = "required" if name in schema["required"] else _default(field)
        rows.append(_row([f"`{name}`", _type_text(field), default, field["description"]]))
    return "\n".join(rows) + "\n"


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


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
            return _scalar(scalar)


def _scalar(schema: dict[str, Any]) -> str:
    match schema:
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
            return str(schema.get("type", "any value"))
