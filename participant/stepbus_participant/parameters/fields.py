"""The nodes of a declaration of parameters, and how each field of a mapping is read."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect

from stepbus_participant.hints import suggest

from .problems import Keys, Problems, show
from .settings import PerName, Settings

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


def empty(node: inspect.Type) -> Any:
    """Return something of a type that stands for a value that is missing or wrong."""
    match node:
        case inspect.Metadata():
            value = empty(node.type)
        case inspect.StructType():
            rows = [field for field in node.fields if field.required]
            value = node.cls(**{field.name: empty(field.type) for field in rows})
        case inspect.TupleType():
            value = tuple(empty(item) for item in node.item_types)
        case inspect.LiteralType():
            value = node.values[0]
        case inspect.UnionType():
            value = None if inspect.NoneType() in node.types else empty(node.types[0])
        case inspect.CustomType():
            value = PerName(0.0) if node.cls is PerName else Path()
        case _:
            value = _PLAIN.get(type(node), _OTHER)[2]
    return value


def default(field: inspect.Field) -> Any:
    """Return the default of a field that has one."""
    if field.default is not msgspec.NODEFAULT:
        return field.default
    return field.default_factory()


def _extra(node: inspect.Type) -> Mapping[str, Any]:
    return (node.extra if isinstance(node, inspect.Metadata) else None) or {}


def conditions(field: inspect.Field) -> Mapping[str, tuple[Any, ...]]:
    """Return which values of other keys a field belongs to; see `settings.when`."""
    when: Mapping[str, tuple[Any, ...]] = _extra(field.type).get("when", {})
    return when


def is_ignored(field: inspect.Field) -> bool:
    """Return whether a field may stay where it means nothing; see `settings.needed_when`."""
    return bool(_extra(field.type).get("ignored"))


def mark(node: inspect.Type) -> str:
    """Return the mark of a type of `settings.py`, such as `duration`, or nothing."""
    return str(_extra(node).get("read", ""))


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
    if isinstance(data, bool):
        return isinstance(bare, inspect.BoolType)
    return isinstance(data, _PLAIN.get(type(bare), _OTHER)[0])


def noun(node: inspect.Type) -> str:
    """Return what a value of a type is called in a sentence."""
    bare = plain(node)
    if isinstance(bare, inspect.LiteralType):
        return listed(bare.values)
    return _PLAIN.get(type(bare), _OTHER)[1]


def words_of(options: Sequence[inspect.Type]) -> list[Any]:
    """Return the words that a choice is between."""
    plains = (plain(item) for item in options)
    return [w for item in plains if isinstance(item, inspect.LiteralType) for w in item.values]


def listed(words: Sequence[object]) -> str:
    """Return `a, b or c`, as YAML has them."""
    *most, last = (str(word).lower() if isinstance(word, bool) else str(word) for word in words)
    return f"{', '.join(most)} or {last}" if most else last


class Fields:
    """The fields of one struct; data: without the keys that are null.

    read: returns data as what a node of a type describes. short: key of the struct that a text
    stands for, where the data is one.
    """

    def __init__(
        self,
        *,
        read: Callable[[inspect.Type, Any, Keys], Any],
        problems: Problems,
        node: inspect.StructType,
        data: Mapping[Any, Any],
        keys: Keys,
        short: str,
    ) -> None:
        self._read, self._problems = read, problems
        self._data, self._keys, self._short = data, keys, short
        self._fields = {f.encode_name: f for f in node.fields if not is_own(f)}
        settings: Any = node.cls
        self._elsewhere = settings.elsewhere
        self._own = [field.name for field in node.fields if is_own(field)]
        # Whether the data names a class of the user's own.
        self._has_plugin = any(
            isinstance(value := data.get(key), str) and ":" in value
            for key, field in self._fields.items()
            if is_plugin(field.type)
        )

    def values(self) -> dict[str, Any]:
        """Return name of a field → value; what is wrong is added to the problems."""
        values = {field.name: self._value(key, field) for key, field in self._fields.items()}
        surplus = {key: item for key, item in self._data.items() if self._is_surplus(key)}
        if not self._has_plugin:
            for key in surplus:
                text = self._unknown(key) if isinstance(key, str) else not_text(key)
                self._problems.add((*self._keys, str(key)), text)
            surplus = {}
        self._check_names(values)
        return values | dict.fromkeys(self._own, surplus)

    def _unknown(self, key: str) -> str:
        place = self._elsewhere(key)
        return f"unknown key {key!r}{f'; {place}' if place else suggest(key, self._fields)}"

    def _is_surplus(self, key: Any) -> bool:
        field = self._fields.get(key)
        return field is None or (self._has_plugin and self._applies(field) is False)

    def _value(self, key: str, field: inspect.Field) -> Any:
        instead = empty(field.type) if field.required else default(field)
        where, applies = (*self._keys, key), self._applies(field)
        if key not in self._data:
            if field.required and applies and not self._problems.has(where):
                self._problems.add(self._keys, f"the key {key!r} is missing")
            return instead
        if applies is False and not is_ignored(field):
            if not self._has_plugin:
                self._problems.add(where, self._misplaced(field))
            return instead
        before = len(self._problems)
        where = (*self._keys, *without(self._short, (key,)))
        value = self._read(field.type, self._data[key], where)
        wrong = len(self._problems) > before
        # What is right in a map is kept; a participant without outputs would be a second problem.
        replaced = wrong and not field.required and not isinstance(value, Settings | dict)
        return instead if replaced else value

    def _applies(self, field: inspect.Field) -> bool | None:
        """Return whether a field means something beside the others; None: they do not decide it."""
        wanted = conditions(field)
        if not self._has_plugin and not all(self._is_decided(key) for key in wanted):
            return None
        return all(self._setting(key) in values for key, values in wanted.items())

    def _is_decided(self, key: str) -> bool:
        """Return whether a key has a value that it may have."""
        return self._setting(key) in (*words_of(options_of(self._fields[key].type)), True, False)

    def _setting(self, key: str) -> Any:
        """Return the value of another field, as it stands or by default."""
        field = self._fields[key]
        value = self._data.get(key, None if field.required else default(field))
        return value if isinstance(value, str | bool) else None

    def _misplaced(self, field: inspect.Field) -> str:
        wanted = " and ".join(f"{k} {listed(v)}" for k, v in conditions(field).items())
        now = " and ".join(f"{k} is {show(self._setting(k))}" for k in conditions(field))
        return f"belongs to {wanted}; {now}"

    def _check_names(self, values: Mapping[str, Any]) -> None:
        """Add what does not fit `joints` among the numbers that are one for each of them."""
        joints = values.get("joints")
        if not joints or "joints" not in self._data:
            return
        for key, field in self._fields.items():
            value = values[field.name]
            if isinstance(value, PerName) and key in self._data:
                for where, text in value.misfits(joints):
                    self._problems.add((*self._keys, key, *where), text)


def without(short: str, where: Keys) -> Keys:
    """Return keys without the first, where a text stands for that one."""
    return where[1:] if short and where[:1] == (short,) else where


def not_text(key: object) -> str:
    """Return what is wrong with a key that is no text."""
    return f"a key must be text, not {key!r}; put it in quotes"
