"""The message types that a recording brings, from its schemas."""

import contextlib
import json
from collections.abc import Mapping

from stepbus_orchestrator.recording import layout
from stepbus_schemas import ENVELOPE_TYPES, MESSAGE_TYPES, Types, WiringError, declaration_of

_NO_SCHEMA = (ValueError, LookupError, TypeError, AttributeError, RecursionError)


def recorded_types(schemas: Mapping[str, bytes]) -> Types:
    """Return the types of a recording's schemas, by their names in the file.

    One that says no type stays unknown: reading its messages says so.
    """
    found = Types()
    for name, text in schemas.items():
        type_name = layout.type_of_schema(name)
        if type_name in MESSAGE_TYPES or type_name in ENVELOPE_TYPES:
            continue
        with contextlib.suppress(WiringError, *_NO_SCHEMA):
            found |= Types({type_name: declaration_of(type_name, json.loads(text))})
    return found
