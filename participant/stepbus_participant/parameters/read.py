"""Plain data, as YAML and MessagePack have it, into `Settings`; every problem is collected.

One function for each type of a field. Each returns a value of that type, also for data that is
wrong, so that reading continues and the rest is checked too; the caller refuses in the end.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from stepbus_participant.files import find_file
from stepbus_schemas import listed, nearest, suggest

from .durations import parse_duration
from .kinds import LONGEST_NAME, NAME_FORM, PerName
from .nodes import (
    conditions,
    default,
    empty,
    is_ignored,
    is_own,
    is_plugin,
    mark,
    noun,
    options_of,
    plain,
    takes,
    words_of,
)
from .problems import Keys, Problems, TooManyProblems, show

S = TypeVar("S", bound=msgspec.Struct)
T = TypeVar("T")
_LARGEST = 1e300
_WITH_UNIT = re.compile(r"([-+]?[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?) *(\D{0,12})")


def is_name(text: str) -> bool:
    """Return whether a scenario may call a participant or a port like this: it is never a path."""
    return len(text) <= LONGEST_NAME and re.fullmatch(NAME_FORM, text) is not None


def read(
    settings: type[S],
    data: object,
    problems: Problems,
    *,
    folder: Path | None = None,
    keys: Keys = (),
) -> S:
    """Return plain data as settings; what is wrong is added to the problems.

    A value that is wrong is replaced by its default or by something empty. folder: what relative
    file names are relative to; None: files are not checked. keys: where the data stands.
    """
    value = read_value(settings, data, problems, folder=folder, keys=keys)
    assert isinstance(value, settings)  # noqa: S101  for mypy: the node is of this class
    return value


def read_value(
    wanted: Any, data: object, problems: Problems, *, folder: Path | None = None, keys: Keys = ()
) -> Any:
    """Return plain data as any type that a field may have, such as `dict[str, Positive]`."""
    return _Reader(problems, folder).value(inspect.type_info(wanted), data, keys)


def find_problems(
    settings: type[Any], data: object, folder: Path | None = None
) -> list[tuple[Keys, str]]:
    """Return what is wrong with plain data: keys and a sentence each."""
    problems = Problems()
    try:
        value = read(settings, data, problems, folder=folder)
    except TooManyProblems:
        return problems.plain
    return problems.plain or list(value.file_problems())


@dataclass(frozen=True)
class _Reader:
    problems: Problems
    folder: Path | None

    def value(self, node: inspect.Type, data: Any, keys: Keys) -> Any:
        """Return data as what a node of a type describes."""
        if isinstance(node, inspect.Metadata):
            marked = getattr(self, f"_{mark(node)}", None)
            return marked(node, data, keys) if marked else self.value(node.type, data, keys)
        return _BY_NODE[type(node)](self, node, data, keys)

    def wrong(self, keys: Keys, message: str, instead: T) -> T:
        """Add a problem; return what stands for the value instead."""
        self.problems.add(keys, message)
        return instead

    def _struct(self, node: Any, data: Any, keys: Keys) -> Any:
        cls = node.cls
        if isinstance(data, cls):
            return data
        short = cls.short if isinstance(data, str) else ""
        if short:
            data = {short: data}
        required = [field.encode_name for field in node.fields if field.required]
        if data is None and not required:
            data = {}
        if not isinstance(data, Mapping):
            form = "text or a map" if cls.short else "a map"
            if data is not None:
                self.problems.add(keys, f"must be {form}, not {show(data)}")
            elif required and not self.problems.has(keys):
                self.problems.add(keys, f"is empty; it needs at least {', '.join(required)}")
            return empty(node)
        before = len(self.problems)
        given = {key: item for key, item in data.items() if item is not None}
        value = cls(**_Fields(self, node, given, keys, short).values())
        if len(self.problems) == before:
            for where, text in value.problems():
                self.problems.add((*keys, *_without(short, where)), text)
        return value

    def _simple(self, node: Any, data: Any, keys: Keys) -> Any:
        if not takes(node, data):
            is_bare = isinstance(node, inspect.StrType) and takes(inspect.FloatType(), data)
            hint = "; put it in quotes" if is_bare else _number_hint(node, data)
            return self.wrong(keys, f"must be {noun(node)}, not {show(data)}{hint}", empty(node))
        match node:
            case inspect.DictType():
                return self._dict(node, data, keys)
            case inspect.VarTupleType():
                return self._tuple(node, data, keys)
            case inspect.IntType() | inspect.FloatType():
                return self._number(node, data, keys)
        if isinstance(node, inspect.StrType) and node.min_length and not data:
            self.problems.add(keys, "must not be empty")
        return data

    def _dict(self, node: inspect.DictType, data: Any, keys: Keys) -> dict[str, Any]:
        values = {}
        for key, item in data.items():
            if item is None and isinstance(plain(node.value_type), _SCALARS):
                continue
            if isinstance(key, str):
                self.value(node.key_type, key, (*keys, key))
                values[key] = self.value(node.value_type, item, (*keys, key))
            else:
                self.problems.add((*keys, str(key)), _not_text(key))
        return values

    def _tuple(self, node: inspect.VarTupleType, data: Any, keys: Keys) -> tuple[Any, ...]:
        if node.min_length is not None and len(data) < node.min_length:
            least = f"; it needs at least {node.min_length}" if node.min_length > 1 else ""
            self.problems.add(keys, f"has only {len(data)}{least}" if data else f"is empty{least}")
        return tuple(self.value(node.item_type, item, (*keys, i)) for i, item in enumerate(data))

    def _fixed(self, node: inspect.TupleType, data: Any, keys: Keys) -> tuple[Any, ...]:
        count = len(node.item_types)
        if not isinstance(data, list | tuple) or len(data) != count:
            what = f"a list of {len(data)}" if isinstance(data, list | tuple) else show(data)
            return self.wrong(keys, f"must be a list of {count} values, not {what}", empty(node))
        rows = enumerate(zip(node.item_types, data, strict=True))
        return tuple(self.value(item, value, (*keys, i)) for i, (item, value) in rows)

    def _number(self, node: inspect.IntType | inspect.FloatType, data: float, keys: Keys) -> float:
        instead: float = empty(node)
        if isinstance(instead, float) and not -_LARGEST <= data <= _LARGEST:
            limit = "a finite number"
        elif node.gt is not None and not data > node.gt:
            limit = f"above {node.gt:g}"
        elif node.ge is not None and not data >= node.ge:
            limit = f"at least {node.ge}"
        elif node.le is not None and not data <= node.le:
            limit = f"at most {node.le}"
        else:
            return type(instead)(data)
        return self.wrong(keys, f"must be {limit}, not {show(data)}", instead)

    def _one_of(self, node: inspect.Type, data: Any, keys: Keys) -> Any:
        """Return data as the option of a type that takes it."""
        options = options_of(node)
        if data is None and isinstance(node, inspect.UnionType):
            return None
        for item in options:
            if takes(item, data):
                is_word = isinstance(plain(item), inspect.LiteralType)
                return data if is_word else self.value(item, data, keys)
        words = words_of(options)
        is_choice = all(is_plugin(item) or words_of([item]) for item in options)
        if words and (isinstance(data, str) or is_choice):
            own = ["file.py:Class"] if any(map(is_plugin, options)) else []
            near = nearest(data, words) if isinstance(data, str) else ""
            text = f"must be {listed([*words, *own])}, not {show(data)}{near}"
            return self.wrong(keys, text, words[0])
        if len(options) == 1:
            return self.value(options[0], data, keys)
        names = " or ".join(dict.fromkeys(noun(item) for item in options))
        return self.wrong(keys, f"must be {names}, not {show(data)}", None)

    # Marked types of kinds.py

    def _duration(self, _node: Any, data: Any, keys: Keys, *, may_be_zero: bool = False) -> int:
        if not isinstance(data, str):
            text = f"must be a duration with a unit, e.g. 5ms, not {show(data)}"
            return self.wrong(keys, text, 0)
        parse = partial(parse_duration, data, may_be_zero=may_be_zero)
        return self.problems.attempt(keys, parse) or 0

    def _pause(self, node: Any, data: Any, keys: Keys) -> int:
        return self._duration(node, data, keys, may_be_zero=True)

    def _name(self, _node: Any, data: Any, keys: Keys) -> str:
        if not isinstance(data, str) or is_name(data):
            return str(self.value(inspect.StrType(), data, keys))
        text = (
            f"{data!r} is not a valid name; use 1 to {LONGEST_NAME} letters, digits, '_' and '-', "
            "starting with a letter or digit"
        )
        return self.wrong(keys, text, "")

    def _file(self, _node: Any, data: Any, keys: Keys) -> Path:
        if not isinstance(data, str) or not data or "\0" in data:
            return self.wrong(keys, f"must be a file name, not {show(data)}", Path())
        if self.folder is None:
            return Path(data)
        path = self.problems.attempt(keys, partial(find_file, data, self.folder)) or Path()
        if path.is_dir() and path != Path():
            return self.wrong(keys, f"{data!r} is a folder ({path})", Path())
        return path

    def _model(self, node: Any, data: Any, keys: Keys) -> Path:
        path = self._file(node, data, keys)
        if self.folder is not None and path != Path():
            # By name: this package reads no robots, and few participants need one.
            read_robot = import_module("stepbus_models").read_robot
            self.problems.attempt(keys, partial(read_robot, path))
        return path

    def _names(self, node: Any, data: Any, keys: Keys) -> tuple[str, ...]:
        before = len(self.problems)
        names = self.value(node.type, data, keys)
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        if twice and len(self.problems) == before:
            self.problems.add(keys, f"names {', '.join(map(repr, twice))} twice")
        return tuple(dict.fromkeys(names))

    def _per_name(self, node: Any, data: Any, keys: Keys) -> PerName:
        wanted = inspect.type_info(node.extra["item"])
        if isinstance(data, Mapping):
            wanted = inspect.DictType(inspect.StrType(), wanted)
        elif isinstance(data, list | tuple):
            wanted = inspect.VarTupleType(wanted)
        return PerName(self.value(wanted, data, keys), self.problems.path(keys))


def _number_hint(node: inspect.Type, data: Any) -> str:
    """Return what to write instead of a text that was to be a number, such as `45deg`."""
    wanted = isinstance(node, inspect.FloatType | inspect.IntType)
    form = _WITH_UNIT.fullmatch(data.strip()) if wanted and isinstance(data, str) else None
    if form is None:
        return ""
    number, unit = form[1], form[2]
    if unit and isinstance(node, inspect.IntType):
        return "; it is a count, without a unit"
    if not unit:
        return f"; remove the quotes: {number}"
    if unit in {"deg", "°", "degree", "degrees"}:
        return f"; angles are in radians: {number}° is {math.radians(float(number)):.6g}"
    if unit == "%":
        return f"; write a fraction: {float(number) / 100:g}"
    return "; write only the number, in the unit given in the key's documentation"


_SCALARS = (inspect.StrType, inspect.IntType, inspect.FloatType, inspect.BoolType)
_BY_NODE: Mapping[type, Callable[[_Reader, Any, Any, Keys], Any]] = {
    inspect.AnyType: lambda _reader, _node, data, _keys: data,
    inspect.LiteralType: _Reader._one_of,
    inspect.StructType: _Reader._struct,
    inspect.TupleType: _Reader._fixed,
    inspect.UnionType: _Reader._one_of,
    **dict.fromkeys((*_SCALARS, inspect.DictType, inspect.VarTupleType), _Reader._simple),
}


class _Fields:
    """The fields of one struct; data: without the keys that are null.

    short: key of the struct that a text stands for, where the data is one.
    """

    def __init__(
        self,
        reader: _Reader,
        node: inspect.StructType,
        data: Mapping[Any, Any],
        keys: Keys,
        short: str,
    ) -> None:
        self._reader, self._problems = reader, reader.problems
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
                text = self._unknown(key) if isinstance(key, str) else _not_text(key)
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
        where = (*self._keys, *_without(self._short, (key,)))
        value = self._reader.value(field.type, self._data[key], where)
        wrong = len(self._problems) > before
        # What is right in a map is kept; a participant without outputs would be a second problem.
        replaced = wrong and not field.required and not isinstance(value, msgspec.Struct | dict)
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
        return f"applies only with {wanted}; here {now}"

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


def _without(short: str, where: Keys) -> Keys:
    """Return keys without the first, where a text stands for that one."""
    return where[1:] if short and where[:1] == (short,) else where


def _not_text(key: object) -> str:
    return f"a key must be text, not {key!r}; put it in quotes"
