"""Plain data, as YAML and MessagePack have it, into `Settings`; every problem is collected.

`msgspec.convert` reads each value by itself, so that every wrong value is found. A wrong value is
replaced by its default or by something empty, and the rest is read too.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec
from msgspec import structs

from stepbus_schemas import listed, nearest, suggest

from .kinds import NAME_FORM, PerName
from .problems import Keys, Problems, show

_T = TypeVar("_T")
_NOUNS = {
    str: "text",
    int: "an integer",
    float: "a number",
    bool: "true or false",
    dict: "a map",
    tuple: "a list",
}
_LIMITS = {"gt": "above", "ge": "of at least", "lt": "below", "le": "of at most"}
_REACHED = 1e18
"""Larger limits only keep a number finite, or within 64 bits."""


def is_name(text: str) -> bool:
    """Return whether a scenario may call a participant or a port like this: it is never a path."""
    return re.fullmatch(NAME_FORM, text) is not None


def read(
    wanted: type[_T],
    data: object,
    problems: Problems,
    *,
    folder: Path | None = None,
    keys: Keys = (),
) -> _T:
    """Return plain data as an instance of a type that a field may have, such as a `Settings`.

    problems: every mistake is added to it. folder: base of relative file names; None: files are
    not checked. keys: path of the data.
    """
    value: _T = _Reader(problems, folder).value(wanted, data, keys)
    return value


def find_problems(
    settings: type[Any], data: object, folder: Path | None = None
) -> list[tuple[Keys, str]]:
    """Return all problems of plain data as (keys, message) pairs."""
    problems = Problems()
    value = read(settings, data, problems, folder=folder)
    mistakes = [(problem.keys, problem.message) for problem in problems.error().problems]
    return mistakes or list(value.file_problems())


def unmarked(wanted: Any) -> tuple[Any, dict[str, Any]]:
    """Return a type without its metadata, and the metadata by name."""
    if get_origin(wanted) is not Annotated:
        return wanted, {}
    marks: dict[str, Any] = {}
    for meta in wanted.__metadata__:
        for name in (*_LIMITS, "min_length", "description"):
            if (value := getattr(meta, name)) is not None:
                marks[name] = value
        marks |= meta.extra or {}
    return wanted.__origin__, marks


def options_of(wanted: Any) -> tuple[Any, ...]:
    """Return the types of a union; of any other type, the type itself."""
    bare, _ = unmarked(wanted)
    return get_args(bare) if get_origin(bare) in (Union, UnionType) else (wanted,)


def kind_of(wanted: Any) -> Any:
    """Return the class of a type: `tuple` for `tuple[float, ...]`."""
    bare, _ = unmarked(wanted)
    return get_origin(bare) or bare


def is_settings(kind: Any) -> bool:
    """Return whether a type is a class of settings."""
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


@cache
def fields_of(settings: type[Any]) -> dict[str, structs.FieldInfo]:
    """Return key → field, without the field that collects the keys of a class of the user's."""
    fields = {field.encode_name: field for field in structs.fields(settings)}
    return {key: field for key, field in fields.items() if "own" not in unmarked(field.type)[1]}


def default_of(field: structs.FieldInfo) -> Any:
    """Return the default of a field; of a required field, an empty value."""
    if field.required:
        return _empty(field.type)
    if field.default is not msgspec.NODEFAULT:
        return field.default
    return field.default_factory()


def _empty(wanted: Any) -> Any:
    kind = kind_of(options_of(wanted)[0])
    if is_settings(kind):
        return kind(**{f.name: _empty(f.type) for f in structs.fields(kind) if f.required})
    return kind() if kind in _NOUNS else None


@dataclass(frozen=True)
class _Reader:
    problems: Problems
    folder: Path | None

    def value(self, wanted: Any, data: Any, keys: Keys) -> Any:
        """Return data as a type; where that is not possible, add a problem and return a default."""
        options = options_of(wanted)
        if data is None and NoneType in options:
            return None
        for option in options:
            try:
                return self._option(option, data, keys)
            except msgspec.ValidationError:
                continue
        self.problems.add(keys, _mistake(options, data))
        return _empty(wanted)

    def _option(self, wanted: Any, data: Any, keys: Keys) -> Any:
        """Return data as a type; raises ValidationError where it is of another kind."""
        bare, marks = unmarked(wanted)
        kind, arguments = get_origin(bare) or bare, get_args(bare)
        if "read" in marks:
            return self._made(kind, marks, data, keys)
        if is_settings(kind) and (data is None or isinstance(data, Mapping | kind)):
            return self._settings(kind, data or {}, keys)
        if is_settings(kind) and kind.short and isinstance(data, str):
            return self._settings(kind, {kind.short: data}, keys, short=kind.short)
        if kind is dict and isinstance(data, Mapping):
            return self._map(arguments, data, keys)
        if kind is tuple and isinstance(data, list | tuple):
            is_fixed = arguments[-1] is not ...
            kinds = arguments if is_fixed else arguments[:1] * len(data)
            if len(kinds) == len(data) >= marks.get("min_length", 0):
                rows = enumerate(zip(kinds, data, strict=True))
                return tuple(self.value(item, row, (*keys, i)) for i, (item, row) in rows)
        if kind in (dict, tuple) or is_settings(kind):
            raise msgspec.ValidationError
        return msgspec.convert(data, wanted)

    def _made(self, kind: Any, marks: Mapping[str, Any], data: Any, keys: Keys) -> Any:
        """Return what the function of a type makes of data; None where that fails."""
        before = len(self.problems)
        value = self.value(marks["of"], data, keys)
        if len(self.problems) > before:
            return None
        if kind is PerName:
            return PerName(value, (*self.problems.above, *keys))
        return self.problems.attempt(keys, partial(marks["read"], value, self.folder))

    def _map(self, arguments: Sequence[Any], data: Any, keys: Keys) -> dict[str, Any]:
        (key_type, item_type), values = arguments, {}
        for key, item in data.items():
            at = (*keys, str(key))
            self.value(key_type, key, at)
            # A key that is null counts as absent.
            if item is not None or item_type is Any or is_settings(item_type):
                values[str(key)] = self.value(item_type, item, at)
        return values

    def _settings(self, cls: Any, data: Any, keys: Keys, short: str = "") -> Any:
        """Return a map as settings. short: key whose value stands at `keys` itself."""
        if isinstance(data, cls):
            return data
        before = len(self.problems)
        given = {str(key): item for key, item in data.items() if item is not None}
        tag, kinds = cls.kinds
        word = str(given.get(tag, default_of(fields_of(cls)[tag]))) if tag else ""
        kind = kinds.get(word, cls)
        values: dict[str, Any] = {}
        for key, field in fields_of(kind).items():
            at = keys if key == short else (*keys, key)
            values[field.name] = self._field(field, given.pop(key, None), keys, at)
        own = next((key for key in kind.__struct_encode_fields__ if key not in fields_of(kind)), "")
        if own and (":" in word or not kinds):
            values[own], given = given, {}
        for key in given:
            # Which keys apply is known once the word is right.
            if word in kinds or not _words(cls, key):
                self.problems.add((*keys, key), _unknown(cls, kind, key))
        self._check_joints(values, keys)
        made = kind(**values)
        if len(self.problems) == before:
            for at, text in made.problems():
                self.problems.add((*keys, *(at if at != (short,) else ())), text)
        return made

    def _field(self, field: structs.FieldInfo, data: Any, above: Keys, at: Keys) -> Any:
        if data is None:
            if field.required and not self.problems.has(at):
                self.problems.add(above, f"the key {field.encode_name!r} is missing")
            return default_of(field)
        before = len(self.problems)
        value = self.value(field.type, data, at)
        # What is right in a map is kept; a participant without outputs would be a second problem.
        is_kept = field.required or isinstance(value, msgspec.Struct | dict)
        return value if is_kept or len(self.problems) == before else default_of(field)

    def _check_joints(self, values: Mapping[str, Any], keys: Keys) -> None:
        """Add a problem for each `PerName` that does not fit `joints`."""
        joints = values.get("joints") or ()
        for key, value in values.items() if joints else ():
            if isinstance(value, PerName):
                for at, text in value.misfits(joints):
                    self.problems.add((*keys, key, *at), text)


def _unknown(cls: Any, kind: Any, key: str) -> str:
    """Return why settings have no such key. kind: the subclass of `cls` that was read."""
    if words := _words(cls, key):
        return f"applies only with {cls.kinds[0]} {listed(words)}"
    place = cls.elsewhere(key)
    return f"unknown key {key!r}{f'; {place}' if place else suggest(key, fields_of(kind))}"


def _words(cls: Any, key: str) -> list[str]:
    """Return the words whose subclass of settings has a key."""
    return [word for word, kind in cls.kinds[1].items() if key in fields_of(kind)]


def _mistake(options: Sequence[Any], data: Any) -> str:
    """Return why data has none of some types: `must be a, b or a map, not 'c'`, and a hint."""
    words = [word for option in options for word in get_args(option) if kind_of(option) is Literal]
    others = [_noun(o) for o in options if kind_of(o) not in (Literal, NoneType)]
    is_number = isinstance(data, int | float)
    hint = "; put it in quotes" if is_number and _NOUNS[str] in others else nearest(data, words)
    return f"must be {listed([*words, *others])}, not {show(data)}{hint}"


def _noun(wanted: Any) -> str:
    """Return a type in words: `a number above 0`, `an integer from 1 to 9`."""
    bare, marks = unmarked(wanted)
    kind = kind_of(wanted)
    if "description" in marks:
        return str(marks["description"])
    if is_settings(kind):
        return "text or a map" if kind.short else "a map"
    if kind is tuple and get_args(bare)[-1] is not ...:
        return f"a list of {len(get_args(bare))} values"
    limits = {name: marks[name] for name in _LIMITS if abs(marks.get(name, _REACHED)) < _REACHED}
    if limits.keys() == {"ge", "le"}:
        return f"{_NOUNS[kind]} from {limits['ge']:g} to {limits['le']:g}"
    return " ".join([_NOUNS[kind], *(f"{_LIMITS[n]} {limit:g}" for n, limit in limits.items())])
