"""The contract of stepbus: message types, protocol envelopes and their codec.

What only schemas, tables, vectors and the bridge need is imported when it is first used: each
participant is a process, and loads this at every start.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .catalogue import *
from .codec import *
from .declaration import *
from .errors import *
from .marks import *
from .messages import *
from .protocol import *
from .shapes import *

if TYPE_CHECKING:
    from .bridge import *
    from .schema import *
    from .tables import *
    from .vectors import *

_LATER = {
    "BRIDGE_FORMATS": "bridge",
    "BRIDGE_VERSION": "bridge",
    "BridgeFormat": "bridge",
    "RawLayout": "bridge",
    "field_docstrings": "schema",
    "json_schema": "schema",
    "raw_fields": "bridge",
    "raw_problem": "bridge",
    "types_page": "tables",
    "types_vectors": "vectors",
}
"""Name → module that is imported when it is first used."""


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_LATER[name]}", __name__), name)
