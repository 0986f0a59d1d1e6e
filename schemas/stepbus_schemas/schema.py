"""JSON Schema of every message type, from the types themselves."""

import ast
import inspect
import textwrap
from functools import cache
from itertools import pairwise
from typing import Any

import msgspec

from . import messages, protocol
from .catalogue import SHIPPED, Types
from .messages import Message
from .protocol import ENVELOPE_TYPES, Envelope

DIALECT = "https://json-schema.org/draft/2020-12/schema"

ANY_VALUE = {"description": "any MessagePack value"}
"""Schema of a value that is passed on unread; it accepts anything."""


def json_schema(type_name: str, types: Types = SHIPPED) -> dict[str, Any]:
    """Return the JSON Schema, draft 2020-12, of a message type such as `JointState/1`.

    Port messages and protocol envelopes alike. Beside the standard keywords, vectors have `unit`
    and `shape`, where `n` is the number of names in the port's description. The result is shared
    between callers, which must not change it. types: with those of one's own.

    Raises WiringError when there is no such type, or no such version of it.
    """
    known = ENVELOPE_TYPES.get(type_name)
    return _json_schema(type_name, types[type_name] if known is None else known)


@cache
def _json_schema(type_name: str, cls: type[Message | Envelope]) -> dict[str, Any]:
    (_,), types = msgspec.json.schema_components([cls], ref_template="#/$defs/{name}")
    if cls in {protocol.Batch, protocol.Log}:
        # The entries of a batch are not decoded with it.
        types[cls.__name__]["properties"]["outputs"]["items"] = {"$ref": "#/$defs/Outputs"}
        types |= msgspec.json.schema_components([protocol.Outputs])[1]
    for name, schema in types.items():
        _describe(cls, name, schema)
    if "Outputs" in types:
        types["Outputs"]["properties"]["ports"]["additionalProperties"] = ANY_VALUE
    # Readers of MCAP (Foxglove, PlotJuggler) want the object at the root, not behind a `$ref`.
    root = types.pop(cls.__name__)
    schema = {"$schema": DIALECT, "$id": f"urn:stepbus:{type_name}", **root}
    return schema | ({"$defs": types} if types else {})


def _describe(cls: type, name: str, schema: dict[str, Any]) -> None:
    """Add docstrings: of the class, and of the fields that have no description of their own."""
    part = getattr(protocol, name, None) or getattr(messages, name, None)
    if name == cls.__name__:
        part = cls
    text = schema.get("description") or (part and part.__doc__) or ""
    schema["description"] = inspect.cleandoc(text)
    texts = {} if part is None or issubclass(part, Message) else field_docstrings(part)
    for field, properties in schema["properties"].items():
        properties.setdefault("description", texts.get(field, ""))


@cache
def field_docstrings(cls: type) -> dict[str, str]:
    """Return field → the string below it, bases included; Python itself keeps none of them."""
    definition = _definition(cls)
    inherited = field_docstrings(cls.__base__) if cls.__base__ else {}
    return inherited | {
        field.target.id: text.value.value
        for field, text in pairwise(definition.body if definition else ())
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def _definition(cls: type) -> ast.ClassDef | None:
    """Return a class as its source has it; None of one without, such as a declared one."""
    try:
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    except (OSError, TypeError, SyntaxError, ValueError):
        return None
    return node if isinstance(node, ast.ClassDef) else None
