"""Markdown tables of the message types, for people."""

from collections.abc import Iterable, Sequence
from typing import Any

from .bridge import raw_fields
from .catalogue import SHIPPED, Types
from .declaration import not_null
from .messages import MESSAGE_TYPES
from .schema import json_schema


def port_table(names: Iterable[str] = MESSAGE_TYPES, types: Types = SHIPPED) -> str:
    """Return the table of port types: type, field, value, unit, shape, meaning."""
    rows = []
    for type_name in names:
        label = f"`{type_name}`"
        for name, field in json_schema(type_name, types)["properties"].items():
            value = f"{type_text(field)}, optional" if "default" in field else type_text(field)
            unit, sizes = field.get("unit", ""), field.get("shape", [])
            # As Python writes a tuple.
            shape = f"({', '.join(sizes)}{',' * (len(sizes) == 1)})" if sizes else ""
            rows.append([label, f"`{name}`", value, unit, shape, field["description"]])
            label = ""
    return table(["Type", "Field", "Value", "Unit", "Shape", "Meaning"], rows)


def types_page(names: Sequence[str], types: Types) -> str:
    """Return the table of some types, and what they are in numbers, in format raw of the bridge."""
    numbers = [
        [f"`{name}`", ", ".join(map(str, raw_fields(name, types))) or "not only numbers"]
        for name in names
    ]
    raw = table(["Type", "Numbers in format `raw`"], numbers)
    return f"{port_table(names, types)}\n## Format raw\n\n{raw}"


def table(head: list[str], rows: Iterable[list[str]]) -> str:
    """Return a table of Markdown."""
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return "\n".join([lines[0], f"|{'---|' * len(head)}", *lines[1:]]) + "\n"


def type_text(schema: dict[str, Any]) -> str:
    """Return what a field holds, in words."""
    match not_null(schema):
        case {"$ref": reference}:
            return str(reference).rpartition("/")[2]
        case {"type": "array", "prefixItems": items}:
            return f"({', '.join(map(type_text, items))})"
        case {"type": "array", "items": item}:
            return f"list of {type_text(item)}"
        case {"type": "object", "additionalProperties": item}:
            return f"map to {type_text(item)}"
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
