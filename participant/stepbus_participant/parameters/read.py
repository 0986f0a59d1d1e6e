"""Plain data, as YAML and MessagePack have it, into `Settings`; every problem is collected.

`msgspec.convert` reads each value; maps and lists are gone through here, so that every value that
is wrong is found. It is replaced by its default or by something empty, and the rest is read too.
"""

import math
import re
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec
from msgspec import structs

from stepbus_schemas import listed, nearest, suggest

from .kinds import NAME_FORM, PerName, Plugin
from .problems import Keys, Problems, show

S = TypeVar("S", bound=msgspec.Struct)
_NOUNS = {
    str: "text",
    int: "an integer",
    float: "a number",
    bool: "true or false",
    dict: "a map",
    list: "a list",
    tuple: "a list",
}
_LIMITS = {
    "gt": "above",
    "ge": "of at least",
    "lt": "below",
    "le": "of at most",
    "min_length": "of at least",
}
_UNLIMITED = 1e18
_NUMBER = re.compile(r"[-+]?[0-9]+\.?[0-9]*([eE][-+]?[0-9]+)? *\D{0,12}")


def is_name(text: str) -> bool:
    """Return whether a scenario may call a participant or a port like this: it is never a path."""
    return re.fullmatch(NAME_FORM, text) is not None


def read(
    settings: type[S],
    data: object,
    problems: Problems,
    *,
    folder: Path | None = None,
    keys: Keys = (),
) -> S:
    """Return plain data as settings; what is wrong is added to the problems.

    folder: what relative file names are relative to; None: files are not checked. keys: where the
    data stands.
    """
    value: S = read_value(settings, data, problems, folder=folder, keys=keys)
    return value


def read_value(
    wanted: Any, data: object, problems: Problems, *, folder: Path | None = None, keys: Keys = ()
) -> Any:
    """Return plain data as any type that a field may have, such as `dict[str, Positive]`."""
    return _Reader(problems, folder).value(wanted, data, keys)


def find_problems(
    settings: type[Any], data: object, folder: Path | None = None
) -> list[tuple[Keys, str]]:
    """Return what is wrong with plain data: keys and a sentence each."""
    problems = Problems()
    value = read(settings, data, problems, folder=folder)
    return problems.rows() or list(value.file_problems())


def options_of(wanted: Any) -> tuple[Any, ...]:
    """Return the types that a value may have."""
    bare, _ = unmarked(wanted)
    return get_args(bare) if get_origin(bare) in (Union, UnionType) else (wanted,)


def unmarked(wanted: Any) -> tuple[Any, dict[str, Any]]:
    """Return a type without its marks, and what these say."""
    if get_origin(wanted) is not Annotated:
        return wanted, {}
    marks: dict[str, Any] = {}
    for meta in wanted.__metadata__:
        said = {name: getattr(meta, name) for name in (*_LIMITS, "description")}
        marks |= {name: value for name, value in said.items() if value is not None}
        marks |= meta.extra or {}
    return wanted.__origin__, marks


@cache
def fields_of(settings: Any) -> dict[str, tuple[structs.FieldInfo, dict[str, Any]]]:
    """Return key → field, and what its marks say; a field is behind those that it depends on."""
    rows = {f.encode_name: (f, unmarked(f.type)[1]) for f in structs.fields(settings)}
    return dict(sorted(rows.items(), key=lambda row: "when" in row[1][1]))


@dataclass(frozen=True)
class _Reader:
    problems: Problems
    folder: Path | None

    def value(self, wanted: Any, data: Any, keys: Keys) -> Any:
        """Return data as a type, or what stands for it where it is wrong."""
        options = options_of(wanted)
        if data is None and NoneType in options:
            return None
        for option in options:
            if _takes(option, data):
                return self._read(option, data, keys)
        text = f"must be {_noun(options)}, not {show(data)}{_hint(options, data)}"
        self.problems.add(keys, text)
        return _stand_in(options)

    def _read(self, option: Any, data: Any, keys: Keys) -> Any:
        bare, marks = unmarked(option)
        origin, arguments = get_origin(bare) or bare, get_args(bare)
        if "read" in marks:
            return self.problems.attempt(keys, partial(marks["read"], data, self.folder))
        if origin is PerName:
            return PerName(self.value(_forms(marks), data, keys), (*self.problems.above, *keys))
        if _is_struct(origin):
            return self._struct(origin, data, keys)
        if origin is dict:
            return self._map(*arguments, data, keys)
        if origin in (list, tuple):
            return self._list(option, data, keys)
        return msgspec.convert(data, option)

    def _struct(self, cls: Any, data: Any, keys: Keys) -> Any:
        short = cls.short if isinstance(data, str) else ""
        given = {short: data} if short else data or {}
        before = len(self.problems)
        value = cls(**_Fields(self, cls, given, keys, short).read())
        if len(self.problems) == before:
            for at, text in value.problems():
                self.problems.add((*keys, *(at if at != (short,) else ())), text)
        return value

    def _map(self, key_type: Any, item_type: Any, data: Any, keys: Keys) -> dict[str, Any]:
        values = {}
        for key, item in data.items():
            at = (*keys, str(key))
            self.value(key_type, key, at)
            # A key that is null counts as absent.
            if item is not None or item_type is Any or _is_struct(item_type):
                values[str(key)] = self.value(item_type, item, at)
        return values

    def _list(self, option: Any, data: Any, keys: Keys) -> Any:
        bare, marks = unmarked(option)
        kind, *others = get_args(bare)
        kinds = (kind, *others) if _is_fixed(bare) else (kind,) * len(data)
        rows = enumerate(zip(kinds, data, strict=True))
        values = get_origin(bare)(self.value(kind, item, (*keys, i)) for i, (kind, item) in rows)
        if "distinct" in marks:
            twice = [repr(name) for name, count in Counter(values).items() if count > 1]
            if twice:
                self.problems.add(keys, f"names {', '.join(twice)} twice")
        return values


class _Fields:
    """The fields of one struct, read from a map; short: the key that a text stands for."""

    def __init__(
        self, reader: _Reader, cls: Any, data: Mapping[Any, Any], keys: Keys, short: str
    ) -> None:
        self._reader, self._problems, self._cls = reader, reader.problems, cls
        self._keys, self._short = keys, short
        self._fields = fields_of(cls)
        self._given = {key: item for key, item in data.items() if item is not None}
        self._values: dict[str, Any] = {}
        self._wrong: set[str] = set()
        # Whether the data names a class of the user's own.
        self._has_plugin = any(
            isinstance(value := self._given.get(key), str) and ":" in value
            for key, (field, _) in self._fields.items()
            if Plugin in options_of(field.type)
        )

    def read(self) -> dict[str, Any]:
        """Return name of a field → value; what is wrong is added to the problems."""
        surplus = {key: item for key, item in self._given.items() if key not in self._fields}
        for key, (field, marks) in self._fields.items():
            if "own" in marks:
                continue
            applies = self._applies(marks)
            if key not in self._given:
                self._values[key] = self._absent(key, field, is_needed=applies is True)
            elif applies is not False or "ignored" in marks:
                self._values[key] = self._present(key, field)
            else:
                self._values[key] = _default(field)
                surplus[key] = self._given[key]
        if not self._has_plugin:
            for key in surplus:
                self._problems.add((*self._keys, str(key)), self._unknown(key))
            surplus = {}
        self._check_joints()
        return {
            field.name: surplus if "own" in marks else self._values[key]
            for key, (field, marks) in self._fields.items()
        }

    def _absent(self, key: str, field: structs.FieldInfo, *, is_needed: bool) -> Any:
        if field.required:
            self._wrong.add(key)
            if is_needed and not self._problems.has((*self._keys, key)):
                self._problems.add(self._keys, f"the key {key!r} is missing")
        return _default(field)

    def _present(self, key: str, field: structs.FieldInfo) -> Any:
        before = len(self._problems)
        at = self._keys if key == self._short else (*self._keys, key)
        value = self._reader.value(field.type, self._given[key], at)
        if len(self._problems) == before:
            return value
        self._wrong.add(key)
        # What is right in a map is kept; a participant without outputs would be a second problem.
        is_kept = field.required or isinstance(value, msgspec.Struct | dict)
        return value if is_kept else _default(field)

    def _applies(self, marks: Mapping[str, Any]) -> bool | None:
        """Return whether a field belongs to the values of others; None: these are wrong."""
        wanted = marks.get("when", {})
        if self._wrong & set(wanted):
            return None
        return all(self._values[key] in values for key, values in wanted.items())

    def _unknown(self, key: Any) -> str:
        """Return what is wrong with a key that no field has, or that belongs to other values."""
        if key in self._fields:
            when = self._fields[key][1]["when"]
            wanted = " and ".join(f"{k} {listed(values)}" for k, values in when.items())
            now = " and ".join(f"{k} is {show(self._values[k])}" for k in when)
            return f"applies only with {wanted}; here {now}"
        place = self._cls.elsewhere(str(key))
        known = (key for key, (_, marks) in self._fields.items() if "own" not in marks)
        return f"unknown key {key!r}{f'; {place}' if place else suggest(key, known)}"

    def _check_joints(self) -> None:
        """Add what does not fit `joints` among the numbers that are one for each of them."""
        joints = self._values.get("joints")
        for key in self._given.keys() & self._values.keys() if joints else ():
            value = self._values[key]
            if isinstance(value, PerName):
                for at, text in value.misfits(joints):
                    self._problems.add((*self._keys, key, *at), text)


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _is_fixed(bare: Any) -> bool:
    """Return whether a type is a tuple of a fixed length, such as `tuple[float, float]`."""
    return get_origin(bare) is tuple and get_args(bare)[-1] is not Ellipsis


def _forms(marks: Mapping[str, Any]) -> Any:
    """Return the types that the value of a PerName may have."""
    item = marks["item"]
    return Union[item, tuple[item, ...], dict[str, item]]  # noqa: UP007


def _takes(option: Any, data: Any) -> bool:
    """Return whether data has the form of a type; what it holds may still be wrong."""
    bare, marks = unmarked(option)
    origin = get_origin(bare) or bare
    if "read" in marks:
        return isinstance(data, str) and data != "" and "\0" not in data
    if origin is PerName:
        return any(_takes(form, data) for form in options_of(_forms(marks)))
    if origin is dict or _is_struct(origin):
        is_short = isinstance(data, str) and origin is not dict and origin.short
        is_absent = data is None and origin is not dict
        return isinstance(data, Mapping) or is_short or is_absent
    if origin in (list, tuple):
        least = len(get_args(bare)) if _is_fixed(bare) else marks.get("min_length", 0)
        most = least if _is_fixed(bare) else sys.maxsize
        return isinstance(data, list | tuple) and least <= len(data) <= most
    try:
        msgspec.convert(data, option)
    except msgspec.ValidationError:
        return False
    return True


def _default(field: structs.FieldInfo) -> Any:
    """Return the default of a field, or what stands for a required one."""
    if field.required:
        return _stand_in(options_of(field.type))
    if field.default is not msgspec.NODEFAULT:
        return field.default
    return field.default_factory()


def _stand_in(options: Sequence[Any]) -> Any:
    """Return what stands for a value that is wrong or missing."""
    bare, _ = unmarked(options[0])
    origin = get_origin(bare) or bare
    if NoneType in options:
        return None
    if _is_struct(origin):
        return _Reader(Problems(), None).value(origin, {}, ())
    return origin() if origin in _NOUNS else None


def _noun(options: Iterable[Any]) -> str:
    """Return what a value of some types is called in a sentence: `a number above 0 or a list`."""
    words: list[Any] = []
    for option in options:
        bare, marks = unmarked(option)
        if get_origin(bare) is Literal:
            words += get_args(bare)
        elif bare is PerName:
            words.append(_noun(options_of(_forms(marks))))
        elif bare is not NoneType:
            words.append(marks.get("description") or _described(bare, marks))
    return listed(words)


def _described(bare: Any, marks: Mapping[str, Any]) -> str:
    if _is_struct(bare):
        return "text or a map" if bare.short else "a map"
    if _is_fixed(bare):
        return f"a list of {len(get_args(bare))} values"
    limits = [(word, marks.get(name, math.inf)) for name, word in _LIMITS.items()]
    said = [f"{word} {limit:g}" for word, limit in limits if abs(limit) < _UNLIMITED]
    noun = _NOUNS.get(get_origin(bare) or bare, "something else")
    return f"{noun} {' and '.join(said)}" if said else noun


def _hint(options: Sequence[Any], data: Any) -> str:
    """Return what to write instead of a value that has the wrong form."""
    bare = [unmarked(option)[0] for option in options]
    if isinstance(data, int | float) and str in bare:
        return "; put it in quotes"
    if not isinstance(data, str):
        return ""
    if _NUMBER.fullmatch(data) and any(kind in bare for kind in (int, float, PerName)):
        return "; write only the number, without quotes and unit; angles are in radians"
    words = [word for kind in bare if get_origin(kind) is Literal for word in get_args(kind)]
    return nearest(data, words)
