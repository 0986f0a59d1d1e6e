"""Message types that a user declares: from plain data to a class, and back."""

import json
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, cast

import msgspec

from stepbus_schemas.errors import WiringError
from stepbus_schemas.messages import MESSAGE_TYPES, Message
from stepbus_schemas.protocol import ENVELOPE_TYPES

from .fields import (
    Keys,
    annotation,
    default_of,
    default_problems,
    normal_row,
    row_of,
    row_problems,
)

Declaration = dict[str, Any]
"""A message type as declared: field → its row, and `help`, a sentence about the type."""

MOST_FIELDS = 15
"""A MessagePack map of so many fields has a header of one byte, in every encoder."""
HELP = "help"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,47}/[1-9][0-9]{0,4}")
_FIELD = re.compile(r"[a-z][a-z0-9_]{0,30}")
_PROTOCOL = frozenset(name.partition("/")[0] for name in ENVELOPE_TYPES)


def normal(declaration: Mapping[str, Any]) -> Declaration:
    """Return a declaration in full, each field as a map with the keys that are set."""
    rows = {name: normal_row(row) for name, row in declaration.items() if name != HELP}
    text = declaration.get(HELP)
    return {**({HELP: text} if text else {}), **rows}


def type_problems(name: str, declaration: object) -> Iterator[tuple[Keys, str]]:
    """Yield what is wrong with a type: keys below it and a sentence each."""
    if not _NAME.fullmatch(name):
        yield (), f"{name!r} is no name of a type; write Name/major, such as Thruster/1"
    elif name in MESSAGE_TYPES:
        yield (), f"{name} ships with stepbus; choose another name"
    elif name.partition("/")[0] in _PROTOCOL:
        yield (), f"{name} is a message of the protocol; choose another name"
    if not isinstance(declaration, Mapping):
        yield (), "must be a map: field → type, such as {force: {type: 'float[3]', unit: N}}"
        return
    full = normal(declaration)
    if not isinstance(full.get(HELP, ""), str):
        yield (HELP,), "is a sentence about the type; choose another name for a field"
    fields = {field: row for field, row in full.items() if field != HELP}
    if not 0 < len(fields) <= MOST_FIELDS:
        yield (), f"has {len(fields)} fields; it needs 1 to {MOST_FIELDS}"
    for field, row in fields.items():
        if not _FIELD.fullmatch(field):
            yield (field,), f"{field!r} is no name of a field: small letters, digits and _"
        problems = list(row_problems(row)) or list(default_problems(row))
        yield from (((field, *keys), text) for keys, text in problems)


def declare(name: str, declaration: Mapping[str, Any]) -> type[Message]:
    """Return the class of a declared type, the same one for the same declaration.

    Raises WiringError that lists what is wrong with it.
    """
    problems = [
        ".".join((name, *map(str, keys))) + f": {text}"
        for keys, text in type_problems(name, declaration)
    ]
    if problems:
        raise WiringError("\n".join(problems))
    return _declared(name, json.dumps(normal(declaration)))


@lru_cache(maxsize=1024)
def _declared(name: str, text: str) -> type[Message]:
    declaration = json.loads(text)
    described = declaration.pop(HELP, None)
    fields = [(field, annotation(row), *default_of(row)) for field, row in declaration.items()]
    namespace = {"TYPE": name, "__doc__": described}
    cls = msgspec.defstruct(
        name.partition("/")[0],
        fields,
        bases=(Message,),
        namespace=namespace,
        frozen=True,
        kw_only=True,
    )
    return cast("type[Message]", cls)


def declaration_of(name: str, schema: Mapping[str, Any]) -> Declaration:
    """Return the declaration that a type's JSON Schema says.

    Raises WiringError for a field that no declaration can say.
    """
    row: Declaration = {HELP: schema["description"]} if schema.get("description") else {}
    for field, node in schema["properties"].items():
        try:
            row[field] = row_of(node, required=field in schema.get("required", []))
        except (ValueError, KeyError, TypeError) as exc:
            raise WiringError(f"{name}.{field}: {exc}") from exc
    return row


def differences(one: Declaration, other: Declaration) -> list[tuple[str, str, str]]:
    """Return where two declarations of a type do not fit: field, what one says, what the other.

    A field that only one of them has fits where it may be left out (P14.2); so does other help.
    """
    unequal = []
    for field in dict.fromkeys((*one, *other)):
        if field == HELP:
            continue
        rows = [side.get(field) for side in (one, other)]
        first, second = ("absent" if row is None else describe_row(row) for row in rows)
        is_added = any(row and ("default" in row or "optional" in row) for row in rows)
        if first != second and not (None in rows and is_added):
            unequal.append((field, first, second))
    return unequal


def describe_row(row: Mapping[str, Any]) -> str:
    """Return a field in words, such as `float[n] [N], default 0.0`."""
    form = row["type"]
    parts = [" | ".join(form) if isinstance(form, list) else str(form)]
    parts[0] += f" [{row['unit']}]" if "unit" in row else ""
    parts += ["optional"] if row.get("optional") else []
    parts += [f"default {json.dumps(row['default'])}"] if "default" in row else []
    parts += [f"at least {row['min']}"] if "min" in row else []
    return ", ".join(parts)
