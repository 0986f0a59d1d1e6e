"""Message types of one's own (docs/guide/message_types.md)."""

from .catalogue import SHIPPED, Types, class_declaration, name_of
from .declaration import Declaration, declaration_of, declare, type_problems
from .examples import examples

__all__ = [
    "SHIPPED",
    "Declaration",
    "Types",
    "class_declaration",
    "declaration_of",
    "declare",
    "examples",
    "name_of",
    "type_problems",
]
