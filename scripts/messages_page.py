"""The page of all message types, `docs/reference/messages.md`."""

from typing import Any

from stepbus_schemas import ENVELOPE_TYPES, json_schema
from stepbus_schemas.tables import port_table, table, type_text

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


def _section(name: str, schema: dict[str, Any]) -> str:
    rows = []
    for field, row in schema["properties"].items():
        default = "required" if field in schema["required"] else _default(row)
        rows.append([f"`{field}`", type_text(row), default, row["description"]])
    fields = table(["Field", "Value", "Default", "Meaning"], rows)
    return f"### {name}\n\n{schema['description']}\n\n{fields}"


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
