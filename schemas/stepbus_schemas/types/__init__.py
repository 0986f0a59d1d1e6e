"""Message types of one's own (docs/guide/writing/message_types.md)."""

from .catalogue import SHIPPED, Types, class_declaration, name_of
from .declaration import declaration_of, type_problems
from .examples import examples

__all__ = [
    "SHIPPED",
    "Types",
    "class_declaration",
    "declaration_of",
    "examples",
    "name_of",
    "type_problems",
]
