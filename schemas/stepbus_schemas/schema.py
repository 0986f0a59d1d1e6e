"""JSON Schema of every message type, from the types themselves."""

import ast
import inspect
import sys
import textwrap
from functools import cache
from itertools import pairwise
from typing import Any

import msgspec

from stepbus_schemas import messages, protocol
from stepbus_schemas.messages import Message
from stepbus_schemas.protocol import ENVELOPE_TYPES, Envelope
from stepbus_schemas.types import SHIPPED, Types

DIALECT = "https://json-schema.org/draft/2020-12/schema"

_NO_DOCSTRINGS = 2
"""Level of optimisation (`-OO`) from which Python keeps no docstrings."""

ANY_VALUE = {"description": "any MessagePack value"}
"""Schema of what is passed on without being read; it is empty but for this sentence."""


def json_schema(type_name: str, types: Types = SHIPPED) -> dict[str, Any]:
    """Return the JSON Schema, draft 2020-12, of a message type such as `JointState/1`.

    Port messages and protocol envelopes alike. Beside the standard keywords, vectors have `unit`
    and `shape`, where `n` is the number of names in the port's description. The result is shared
    between callers, who must not change it. types: with those of one's own.

    Raises WiringError when there is no such type, or no such version of it.
    """
    known = ENVELOPE_TYPES.get(type_name)
    return _json_schema(type_name, types[type_name] if known is None else known)


@cache
def _json_schema(type_name: str, cls: type[Message | Envelope]) -> dict[str, Any]:
    (_,), types = msgspec.json.schema_components([cls], ref_template="#/$defs/{name}")
    if cls in {protocol.Batch, protocol.Log}:
        _nest_outputs(types, cls.__name__)
    for name, schema in types.items():
        _describe(cls, name, schema)
    if "Outputs" in types:
        types["Outputs"]["properties"]["ports"]["additionalProperties"] = ANY_VALUE
    # Readers of MCAP (Foxglove, PlotJuggler) want the object at the root, not behind a `$ref`.
    root = types.pop(cls.__name__)
    schema = {"$schema": DIALECT, "$id": f"urn:stepbus:{type_name}", **root}
    return schema | ({"$defs": types} if types else {})


def not_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of what an optional field is when it is there."""
    options: list[dict[str, Any]] = schema.get("anyOf", [])
    return next((option for option in options if option != {"type": "null"}), schema)


def _nest_outputs(types: dict[str, Any], name: str) -> None:
    """Say what the undecoded entries of a batch are."""
    (_,), nested = msgspec.json.schema_components([protocol.Outputs])
    types[name]["properties"]["outputs"]["items"] = {"$ref": "#/$defs/Outputs"}
    types.update(nested)


def _describe(cls: type, name: str, schema: dict[str, Any]) -> None:
    """Add the docstrings of a class's fields to those that have no description of their own."""
    part = getattr(protocol, name, None) or getattr(messages, name, None)
    if name == cls.__name__:
        part = cls
    text = schema.get("description") or ("" if part is None else _docstring(part))
    schema["description"] = inspect.cleandoc(text)
    texts = {} if part is None or issubclass(part, messages.Message) else field_docstrings(part)
    for field, properties in schema["properties"].items():
        properties.setdefault("description", texts.get(field, ""))


def _docstring(cls: type) -> str:
    """Return the docstring of a class, also where `python -OO` has left it out.

    It is in each recording, whose bytes must not depend on that.
    """
    if cls.__doc__ or sys.flags.optimize < _NO_DOCSTRINGS:
        return cls.__doc__ or ""
    try:
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    except (OSError, TypeError, SyntaxError, ValueError):
        # Of a class without source, such as a declared one, there is none to be found.
        return ""
    if not isinstance(definition, ast.ClassDef):
        return ""
    return ast.get_docstring(definition, clean=False) or ""


@cache
def field_docstrings(cls: type) -> dict[str, str]:
    """Return the string below each annotated field; Python itself keeps none of them."""
    (definition,) = ast.parse(inspect.getsource(cls)).body
    statements = definition.body if isinstance(definition, ast.ClassDef) else []
    return {
        field.target.id: text.value.value
        for field, text in pairwise(statements)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }
