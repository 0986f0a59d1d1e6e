"""The nodes of a declaration of parameters: what its types and marks say."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect

from stepbus_schemas import listed

from .kinds import PerName

_PLAIN: Mapping[type, tuple[Any, str, Any]] = {
    inspect.StrType: (str, "text", ""),
    inspect.IntType: (int, "an integer", 0),
    inspect.FloatType: (int | float, "a number", 0.0),
    inspect.BoolType: (bool, "true or false", False),
    inspect.DictType: (Mapping, "a map", {}),
    inspect.StructType: (Mapping, "a map", None),
    inspect.VarTupleType: (list | tuple, "a list", ()),
    inspect.TupleType: (list | tuple, "a list", None),
}
"""Type → data that it takes, what that is called in a sentence, and an empty value."""
_OTHER = (object, "something else", None)


def plain(node: inspect.Type) -> inspect.Type:
    """Return a type without its marks."""
    return plain(node.type) if isinstance(node, inspect.Metadata) else node


def _extra(node: inspect.Type) -> Mapping[str, Any]:
    return (node.extra if isinstance(node, inspect.Metadata) else None) or {}


def mark(node: inspect.Type) -> str:
    """Return the mark of a type of `kinds.py`, such as `duration`, or nothing."""
    return str(_extra(node).get("read", ""))


def is_own(field: inspect.Field) -> bool:
    """Return whether a field collects the parameters of a class of the user's own."""
    return mark(field.type) == "own"


def is_plugin(node: inspect.Type) -> bool:
    """Return whether a type may be the name of a class of the user's own."""
    return mark(node) == "plugin" or any(mark(item) == "plugin" for item in options_of(node))


def conditions(field: inspect.Field) -> Mapping[str, tuple[Any, ...]]:
    """Return which values of other keys a field belongs to; see `kinds.when`."""
    when: Mapping[str, tuple[Any, ...]] = _extra(field.type).get("when", {})
    return when


def is_ignored(field: inspect.Field) -> bool:
    """Return whether a field may stay where it means nothing; see `kinds.needed_when`."""
    return bool(_extra(field.type).get("ignored"))


def options_of(node: inspect.Type) -> list[inspect.Type]:
    """Return the types that a value may have, besides being absent."""
    bare = plain(node)
    types = bare.types if isinstance(bare, inspect.UnionType) else (bare,)
    return [item for item in types if not isinstance(item, inspect.NoneType)]


def words_of(options: Sequence[inspect.Type]) -> list[Any]:
    """Return the words that a choice is between."""
    plains = (plain(item) for item in options)
    return [w for item in plains if isinstance(item, inspect.LiteralType) for w in item.values]


def takes(node: inspect.Type, data: Any) -> bool:
    """Return whether data of this type belongs to an option of a union."""
    bare = plain(node)
    if mark(node) == "plugin":
        return isinstance(data, str) and ":" in data
    if isinstance(bare, inspect.LiteralType):
        return isinstance(data, str) and data in bare.values
    if isinstance(data, bool):
        return isinstance(bare, inspect.BoolType)
    return isinstance(data, _PLAIN.get(type(bare), _OTHER)[0])


def noun(node: inspect.Type) -> str:
    """Return what a value of a type is called in a sentence."""
    bare = plain(node)
    if isinstance(bare, inspect.LiteralType):
        return listed(bare.values)
    return _PLAIN.get(type(bare), _OTHER)[1]


def default(field: inspect.Field) -> Any:
    """Return the default of a field that has one."""
    if field.default is not msgspec.NODEFAULT:
        return field.default
    return field.default_factory()


def empty(node: inspect.Type) -> Any:
    """Return something of a type that stands for a value that is missing or wrong."""
    match plain(node):
        case inspect.StructType(cls=cls, fields=fields):
            return cls(**{field.name: empty(field.type) for field in fields if field.required})
        case inspect.TupleType(item_types=items):
            return tuple(empty(item) for item in items)
        case inspect.LiteralType(values=values):
            return values[0]
        case inspect.UnionType(types=types):
            return None if inspect.NoneType() in types else empty(types[0])
        case inspect.CustomType(cls=cls):
            return PerName(0.0) if cls is PerName else Path()
        case bare:
            return _PLAIN.get(type(bare), _OTHER)[2]
