"""Questions about the types of fields, as `msgspec.inspect` describes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect

from .settings import PerName

_EMPTY: Mapping[type, Any] = {
    inspect.DictType: {},
    inspect.VarTupleType: (),
    inspect.StrType: "",
    inspect.IntType: 0,
    inspect.FloatType: 0.0,
    inspect.BoolType: False,
}


def empty(node: inspect.Type) -> Any:
    """Return something of a type that stands for a value that is missing or wrong."""
    match node:
        case inspect.Metadata():
            found = empty(node.type)
        case inspect.StructType():
            rows = [field for field in node.fields if field.required]
            found = node.cls(**{field.name: empty(field.type) for field in rows})
        case inspect.TupleType():
            found = tuple(empty(item) for item in node.item_types)
        case inspect.LiteralType():
            found = node.values[0]
        case inspect.UnionType():
            found = None if inspect.NoneType() in node.types else empty(node.types[0])
        case inspect.CustomType():
            found = PerName(0.0) if node.cls is PerName else Path()
        case _:
            found = _EMPTY.get(type(node))
    return found


def default(field: inspect.Field) -> Any:
    """Return the default of a field that has one."""
    if field.default is not msgspec.NODEFAULT:
        return field.default
    return field.default_factory()


def conditions(field: inspect.Field) -> Mapping[str, tuple[Any, ...]]:
    """Return which values of other keys a field belongs to; see `settings.when`."""
    extra = field.type.extra if isinstance(field.type, inspect.Metadata) else None
    found: Mapping[str, tuple[Any, ...]] = (extra or {}).get("when", {})
    return found


def is_ignored(field: inspect.Field) -> bool:
    """Return whether a field may stay where it means nothing; see `settings.needed_when`."""
    extra = field.type.extra if isinstance(field.type, inspect.Metadata) else None
    return bool((extra or {}).get("ignored"))


def mark(node: inspect.Type) -> str:
    """Return the mark of a type of `settings.py`, such as `duration`, or nothing."""
    extra = node.extra if isinstance(node, inspect.Metadata) else None
    return str((extra or {}).get("read", ""))


def is_own(field: inspect.Field) -> bool:
    """Return whether a field collects the parameters of a class of the user's own."""
    return mark(field.type) == "own"


def is_plugin(node: inspect.Type) -> bool:
    """Return whether a type may be the name of a class of the user's own."""
    if isinstance(node, inspect.UnionType):
        return any(is_plugin(item) for item in node.types)
    return mark(node) == "plugin"


def plain(node: inspect.Type) -> inspect.Type:
    """Return a type without its marks."""
    return plain(node.type) if isinstance(node, inspect.Metadata) else node


def options_of(node: inspect.Type) -> list[inspect.Type]:
    """Return the types that a value may have, besides being absent."""
    bare = plain(node)
    types = bare.types if isinstance(bare, inspect.UnionType) else (bare,)
    return [item for item in types if not isinstance(item, inspect.NoneType)]


def takes(node: inspect.Type, data: Any) -> bool:
    """Return whether data of this type belongs to an option of a union."""
    if is_plugin(node):
        return isinstance(data, str) and ":" in data
    bare = plain(node)
    if isinstance(bare, inspect.LiteralType):
        return isinstance(data, str) and data in bare.values
    if isinstance(bare, inspect.StructType):
        return isinstance(data, Mapping)
    if isinstance(bare, inspect.BoolType) or isinstance(data, bool):
        return isinstance(bare, inspect.BoolType) and isinstance(data, bool)
    wanted = _DATA.get(type(bare), object)
    return isinstance(data, wanted)


_DATA: Mapping[type, Any] = {
    inspect.StrType: str,
    inspect.IntType: int,
    inspect.FloatType: int | float,
    inspect.DictType: Mapping,
    inspect.VarTupleType: list | tuple,
    inspect.TupleType: list | tuple,
}
_NOUNS: Mapping[type, str] = {
    inspect.StrType: "text",
    inspect.IntType: "an integer",
    inspect.FloatType: "a number",
    inspect.BoolType: "true or false",
    inspect.DictType: "a map",
    inspect.StructType: "a map",
    inspect.VarTupleType: "a list",
    inspect.TupleType: "a list",
}


def noun(node: inspect.Type) -> str:
    """Return what a value of a type is called in a sentence."""
    bare = plain(node)
    if isinstance(bare, inspect.LiteralType):
        return listed(bare.values)
    return _NOUNS.get(type(bare), "something else")


def words_of(options: Sequence[inspect.Type]) -> list[Any]:
    """Return the words that a choice is between."""
    plains = (plain(item) for item in options)
    return [w for item in plains if isinstance(item, inspect.LiteralType) for w in item.values]


def listed(words: Sequence[object]) -> str:
    """Return `a, b or c`."""
    *most, last = (str(word) for word in words)
    return f"{', '.join(most)} or {last}" if most else last
