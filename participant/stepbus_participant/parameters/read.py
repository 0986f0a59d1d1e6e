"""Plain data, as YAML and MessagePack have it, into `Settings`; every problem is collected.

One function for each type of a field. Each returns a value of that type, also for data that is
wrong, so that reading continues and the rest is checked too; the caller refuses in the end.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from msgspec import inspect

from stepbus_participant.files import find_file
from stepbus_schemas import WiringError

from .durations import parse_duration
from .nodes import (
    conditions,
    default,
    empty,
    is_ignored,
    is_own,
    is_plugin,
    listed,
    noun,
    options_of,
    plain,
    takes,
    words_of,
)
from .problems import Keys, Problems, show, suggest
from .settings import LONGEST_NAME, NAME_FORM, PerName, Settings

S = TypeVar("S", bound=Settings)
T = TypeVar("T")
_LARGEST = 1e300


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
    found = _Reader(problems, folder).struct(inspect.type_info(settings), data, keys)
    assert isinstance(found, settings)  # noqa: S101  for mypy: the node is of this class
    return found


def read_value(
    wanted: Any, data: object, problems: Problems, *, folder: Path | None = None, keys: Keys = ()
) -> Any:
    """Return plain data as any type that a field may have, such as `dict[str, Positive]`."""
    return _Reader(problems, folder).value(inspect.type_info(wanted), data, keys)


def find_problems(
    settings: type[Settings], data: object, folder: Path | None = None
) -> list[tuple[Keys, str]]:
    """Return what is wrong with plain data: keys and a sentence each."""
    problems = Problems()
    found = read(settings, data, problems, folder=folder)
    return problems.plain or list(found.file_problems())


@dataclass(frozen=True)
class _Reader:
    problems: Problems
    folder: Path | None

    def value(self, node: inspect.Type, data: Any, keys: Keys) -> Any:
        """Return data as what a node of a type describes."""
        if isinstance(node, inspect.Metadata):
            mark = (node.extra or {}).get("read")
            if mark is not None:
                return getattr(self, f"_{mark}")(node, data, keys)
            return self.value(node.type, data, keys)
        return _BY_NODE[type(node)](self, node, data, keys)

    def wrong(self, keys: Keys, message: str, instead: T) -> T:
        """Add a problem; return what stands for the value instead."""
        self.problems.add(keys, message)
        return instead

    # Structs

    def struct(self, node: Any, data: Any, keys: Keys) -> Any:
        cls = node.cls
        if isinstance(data, cls):
            return data
        short = cls.short if isinstance(data, str) else ""
        if short:
            data = {short: data}
        if not isinstance(data, Mapping):
            form = "text or a map" if cls.short else "a map"
            required = [field.encode_name for field in node.fields if field.required]
            if data is not None:
                self.problems.add(keys, f"must be {form}, not {show(data)}")
            elif required and not self.problems.has(keys):
                self.problems.add(keys, f"is empty; it needs at least {', '.join(required)}")
            return empty(node)
        before = len(self.problems)
        given = {key: item for key, item in data.items() if item is not None}
        values = _Fields(self, node, given, keys, short).values()
        found = cls(**values)
        if len(self.problems) == before:
            for where, text in found.problems():
                self.problems.add((*keys, *_without(short, where)), text)
        return found

    # Containers

    def dict_(self, node: inspect.DictType, data: Any, keys: Keys) -> dict[str, Any]:
        if not isinstance(data, Mapping):
            return self.wrong(keys, f"must be a map, not {show(data)}", {})
        found = {}
        for key, item in data.items():
            if item is None and isinstance(plain(node.value_type), _SCALARS):
                continue
            if isinstance(key, str):
                self.value(node.key_type, key, (*keys, key))
                found[key] = self.value(node.value_type, item, (*keys, key))
            else:
                text = f"a key must be text, not {key!r}; put it in quotes"
                self.problems.add((*keys, str(key)), text)
        return found

    def tuple_(self, node: inspect.VarTupleType, data: Any, keys: Keys) -> tuple[Any, ...]:
        if not isinstance(data, list | tuple):
            return self.wrong(keys, f"must be a list, not {show(data)}", ())
        if node.min_length is not None and len(data) < node.min_length:
            least = f"; it needs at least {node.min_length}" if node.min_length > 1 else ""
            self.problems.add(keys, f"has only {len(data)}{least}" if data else f"is empty{least}")
        return tuple(self.value(node.item_type, item, (*keys, i)) for i, item in enumerate(data))

    def fixed(self, node: inspect.TupleType, data: Any, keys: Keys) -> tuple[Any, ...]:
        count = len(node.item_types)
        if not isinstance(data, list | tuple) or len(data) != count:
            what = f"a list of {len(data)}" if isinstance(data, list | tuple) else show(data)
            return self.wrong(keys, f"must be a list of {count}, not {what}", empty(node))
        rows = enumerate(zip(node.item_types, data, strict=True))
        return tuple(self.value(item, value, (*keys, i)) for i, (item, value) in rows)

    def union(self, node: inspect.UnionType, data: Any, keys: Keys) -> Any:
        if data is None:
            return None
        options = options_of(node)
        for item in options:
            if takes(item, data):
                return self.value(item, data, keys)
        if words_of(options) and (isinstance(data, str) or len(words_of(options)) == len(options)):
            return self._choice(options, data, keys)
        if len(options) == 1:
            return self.value(options[0], data, keys)
        names = " or ".join(dict.fromkeys(noun(item) for item in options))
        return self.wrong(keys, f"must be {names}, not {show(data)}", None)

    def _choice(self, options: Sequence[inspect.Type], data: Any, keys: Keys) -> Any:
        words = words_of(options)
        own = ["module:Class"] if any(is_plugin(item) for item in options) else []
        near = suggest(data, words) if isinstance(data, str) else ""
        text = f"must be {listed([*words, *own])}, not {show(data)}"
        return self.wrong(keys, text + (near if "did you mean" in near else ""), words[0])

    # Scalars

    def text(self, node: inspect.StrType, data: Any, keys: Keys) -> str:
        if not isinstance(data, str):
            quotes = isinstance(data, int | float) and not isinstance(data, bool)
            hint = "; put it in quotes" if quotes else ""
            return self.wrong(keys, f"must be text, not {show(data)}{hint}", "")
        if node.min_length and not data:
            self.problems.add(keys, "must not be empty")
        return str(data)

    def integer(self, node: inspect.IntType, data: Any, keys: Keys) -> int:
        if not isinstance(data, int) or isinstance(data, bool):
            return self.wrong(keys, f"must be an integer, not {show(data)}", 0)
        return data if self._within(node, data, keys) else 0

    def number(self, node: inspect.FloatType, data: Any, keys: Keys) -> float:
        if not isinstance(data, int | float) or isinstance(data, bool):
            return self.wrong(keys, f"must be a number, not {show(data)}", 0.0)
        if not -_LARGEST <= data <= _LARGEST:
            return self.wrong(keys, f"must be a finite number, not {show(data)}", 0.0)
        return float(data) if self._within(node, data, keys) else 0.0

    def _within(self, node: inspect.IntType | inspect.FloatType, data: float, keys: Keys) -> bool:
        if node.gt is not None and not data > node.gt:
            limit = f"above {node.gt:g}"
        elif node.ge is not None and not data >= node.ge:
            limit = f"at least {node.ge}"
        elif node.le is not None and not data <= node.le:
            limit = f"at most {node.le}"
        else:
            return True
        return self.wrong(keys, f"must be {limit}, not {show(data)}", False)

    def flag(self, _node: inspect.BoolType, data: Any, keys: Keys) -> bool:
        if not isinstance(data, bool):
            return self.wrong(keys, f"must be true or false, not {show(data)}", False)
        return data

    def literal(self, node: inspect.LiteralType, data: Any, keys: Keys) -> Any:
        if isinstance(data, str | int) and data in node.values:
            return data
        return self._choice([node], data, keys)

    def anything(self, _node: inspect.Type, data: Any, _keys: Keys) -> Any:
        return data

    # Marked types of settings.py

    def _duration(self, _node: Any, data: Any, keys: Keys) -> int:
        if not isinstance(data, str):
            text = f"must be a duration with a unit, e.g. 5ms, not {show(data)}"
            return self.wrong(keys, text, 0)
        try:
            return parse_duration(data)
        except WiringError as exc:
            return self.wrong(keys, str(exc), 0)

    def _pause(self, node: Any, data: Any, keys: Keys) -> int:
        return 0 if data in ("0s", "0ms") else self._duration(node, data, keys)

    def _name(self, _node: Any, data: Any, keys: Keys) -> str:
        text = self.text(inspect.StrType(), data, keys)
        if isinstance(data, str) and not _is_name(data):
            text = (
                f"{data!r} is no name; it takes 1 to {LONGEST_NAME} letters, digits, '_' and '-', "
                "and starts with a letter or digit"
            )
            return self.wrong(keys, text, "")
        return text

    def _file(self, _node: Any, data: Any, keys: Keys) -> Path:
        if not isinstance(data, str) or not data or "\0" in data:
            return self.wrong(keys, f"must be a file name, not {show(data)}", Path())
        if self.folder is None:
            return Path(data)
        found = self.problems.attempt(keys, partial(find_file, data, self.folder)) or Path()
        if found.is_dir() and found != Path():
            return self.wrong(keys, f"{data!r} is a folder ({found})", Path())
        return found

    def _names(self, node: Any, data: Any, keys: Keys) -> tuple[str, ...]:
        before = len(self.problems)
        found = self.tuple_(node.type, data, keys)
        twice = [name for name in dict.fromkeys(found) if found.count(name) > 1]
        if twice and len(self.problems) == before:
            self.problems.add(keys, f"names {', '.join(map(repr, twice))} twice")
        return tuple(dict.fromkeys(found))

    def _plugin(self, _node: Any, data: Any, keys: Keys) -> str:
        return self.text(inspect.StrType(), data, keys)

    def _per_name(self, node: Any, data: Any, keys: Keys) -> PerName:
        item = inspect.type_info(node.extra["item"])
        wanted: inspect.Type = item
        if isinstance(data, Mapping):
            wanted = inspect.DictType(inspect.StrType(), item)
        elif isinstance(data, list | tuple):
            wanted = inspect.VarTupleType(item)
        return PerName(self.value(wanted, data, keys), self.problems.path(keys))


@dataclass(frozen=True)
class _Fields:
    """The fields of one struct; data: without the keys that are null."""

    reader: _Reader
    node: Any
    data: Mapping[Any, Any]
    keys: Keys
    short: str

    def values(self) -> dict[str, Any]:
        fields = {f.encode_name: f for f in self.node.fields if not is_own(f)}
        surplus = [
            key
            for key in self.data
            if key not in fields or (self._has_plugin() and not self._applies(fields[key]))
        ]
        found = {field.name: self._field(field) for field in fields.values()}
        if not self._has_plugin():
            for key in surplus:
                self._unknown(key, list(fields))
            surplus = []
        self._check_names(found)
        own = {key: self.data[key] for key in surplus}
        return found | {field.name: own for field in self.node.fields if is_own(field)}

    def _unknown(self, key: Any, known: Sequence[str]) -> None:
        if isinstance(key, str):
            text = f"unknown key {key!r}{suggest(key, known)}"
        else:
            text = f"a key must be text, not {key!r}; put it in quotes"
        self.reader.problems.add((*self.keys, str(key)), text)

    def _field(self, field: inspect.Field) -> Any:
        key = field.encode_name
        applies = self._applies(field)
        if key not in self.data:
            is_missing = field.required and applies and self._is_decided(field)
            if is_missing and not self.reader.problems.has((*self.keys, key)):
                self.reader.problems.add(self.keys, f"the key {key!r} is missing")
            return empty(field.type) if field.required else default(field)
        if not applies and not is_ignored(field):
            if not self._has_plugin():
                self.reader.problems.add((*self.keys, key), self._misplaced(field))
            return empty(field.type) if field.required else default(field)
        before = len(self.reader.problems)
        value = self.reader.value(
            field.type, self.data[key], (*self.keys, *_without(self.short, (key,)))
        )
        wrong = len(self.reader.problems) > before
        # What is right in a map is kept; a participant without outputs would be a second problem.
        replaced = wrong and not field.required and not isinstance(value, Settings | dict)
        return default(field) if replaced else value

    def _applies(self, field: inspect.Field) -> bool:
        """Return whether a field means something beside the others, as far as these are known."""
        return not self._is_decided(field) or all(
            self._setting(key) in values for key, values in conditions(field).items()
        )

    def _is_decided(self, field: inspect.Field) -> bool:
        """Return whether the keys that decide about a field have values that they may have."""
        return all(
            self._setting(key) in _options(self._named(key)) or self._has_plugin()
            for key in conditions(field)
        )

    def _misplaced(self, field: inspect.Field) -> str:
        wanted = " and ".join(f"{k} {listed(v)}" for k, v in conditions(field).items())
        now = " and ".join(f"{k} is {show(self._setting(k))}" for k in conditions(field))
        return f"belongs to {wanted}; {now}"

    def _setting(self, key: str) -> Any:
        """Return the value of another field, as it stands or by default."""
        field = self._named(key)
        value = self.data.get(key, None if field.required else default(field))
        return value if isinstance(value, str | bool) else None

    def _named(self, key: str) -> inspect.Field:
        found: inspect.Field = next(f for f in self.node.fields if f.encode_name == key)
        return found

    def _has_plugin(self) -> bool:
        """Return whether the data names a class of the user's own."""
        return any(
            isinstance(value := self.data.get(field.encode_name), str) and ":" in value
            for field in self.node.fields
            if is_plugin(field.type)
        )

    def _check_names(self, found: Mapping[str, Any]) -> None:
        """Add what does not fit `joints` among the numbers that are one for each of them."""
        joints = found.get("joints")
        if not joints or "joints" not in self.data:
            return
        for field in self.node.fields:
            value = found.get(field.name)
            if isinstance(value, PerName) and field.encode_name in self.data:
                for where, text in value.misfits(joints):
                    self.reader.problems.add((*self.keys, field.encode_name, *where), text)


def _without(short: str, where: Keys) -> Keys:
    """Return keys without the first, where a text stands for that one."""
    return where[1:] if short and where[:1] == (short,) else where


def _options(field: inspect.Field) -> Sequence[Any]:
    return (*words_of(options_of(field.type)), True, False)


_BY_NODE: Mapping[type, Callable[[_Reader, Any, Any, Keys], Any]] = {
    inspect.StructType: _Reader.struct,
    inspect.DictType: _Reader.dict_,
    inspect.VarTupleType: _Reader.tuple_,
    inspect.TupleType: _Reader.fixed,
    inspect.UnionType: _Reader.union,
    inspect.StrType: _Reader.text,
    inspect.IntType: _Reader.integer,
    inspect.FloatType: _Reader.number,
    inspect.BoolType: _Reader.flag,
    inspect.LiteralType: _Reader.literal,
    inspect.AnyType: _Reader.anything,
}


_SCALARS = (inspect.StrType, inspect.IntType, inspect.FloatType, inspect.BoolType)


def _is_name(text: str) -> bool:
    return len(text) <= LONGEST_NAME and re.fullmatch(NAME_FORM, text) is not None
