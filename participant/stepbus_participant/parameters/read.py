"""Plain data, as YAML and MessagePack have it, into `Settings`; every problem is collected.

`msgspec.convert` reads each value; maps and lists are gone through here, so that every value that
is wrong is found. It is replaced by its default or by something empty, and the rest is read too.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar

import msgspec
from msgspec import structs

from stepbus_schemas import listed, suggest

from .forms import Form, default_of, fields_of, forms_of, mistake, options_of
from .kinds import NAME_FORM, PerName, Plugin
from .problems import Keys, Problems, show

S = TypeVar("S", bound=msgspec.Struct)


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
    found = [(problem.keys, problem.message) for problem in problems.error().problems]
    return found or list(value.file_problems())


@dataclass(frozen=True)
class _Reader:
    problems: Problems
    folder: Path | None

    def value(self, wanted: Any, data: Any, keys: Keys) -> Any:
        """Return data as a type, or what stands for it where it is wrong."""
        forms = forms_of(wanted)
        is_optional = any(form.type is NoneType for form in forms)
        if data is None and is_optional:
            return None
        form = next((form for form in forms if form.takes(data)), None)
        if form is None:
            self.problems.add(keys, mistake(forms, data))
            return None if is_optional else forms[0].empty
        value = self._read(form, data, keys)
        return PerName(value, (*self.problems.above, *keys)) if form.is_per_name else value

    def _read(self, form: Form, data: Any, keys: Keys) -> Any:
        if "read" in form.marks:
            return self.problems.attempt(keys, partial(form.marks["read"], data, self.folder))
        if form.is_struct and not isinstance(data, form.type):
            return self._struct(form.type, data, keys)
        if form.type is dict:
            return self._map(form, data, keys)
        if form.type in (list, tuple):
            return self._list(form, data, keys)
        return msgspec.convert(data, form.wanted)

    def _struct(self, cls: Any, data: Any, keys: Keys) -> Any:
        short = cls.short if isinstance(data, str) else ""
        given = {short: data} if short else data or {}
        before = len(self.problems)
        value = cls(**_Fields(self, cls, given, keys, short).read())
        if len(self.problems) == before:
            for at, text in value.problems():
                self.problems.add((*keys, *(at if at != (short,) else ())), text)
        return value

    def _map(self, form: Form, data: Any, keys: Keys) -> dict[str, Any]:
        key_type, item_type = form.arguments
        values = {}
        for key, item in data.items():
            at = (*keys, str(key))
            self.value(key_type, key, at)
            # A key that is null counts as absent.
            if item is not None or item_type is Any or forms_of(item_type)[0].is_struct:
                values[str(key)] = self.value(item_type, item, at)
        return values

    def _list(self, form: Form, data: Any, keys: Keys) -> Any:
        kinds = form.arguments if form.is_fixed else form.arguments[:1] * len(data)
        rows = enumerate(zip(kinds, data, strict=True))
        values = form.type(self.value(kind, item, (*keys, i)) for i, (kind, item) in rows)
        counts = Counter(values) if "distinct" in form.marks else {}
        twice = [repr(name) for name, count in counts.items() if count > 1]
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
        fields = fields_of(cls)
        self._fields = {key: row for key, row in fields.items() if "own" not in row[1]}
        self._own = [field.name for field, marks in fields.values() if "own" in marks]
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
        surplus = dict(self._given)
        for key, (field, marks) in self._fields.items():
            applies = self._applies(marks)
            if key in surplus and (applies is not False or "ignored" in marks):
                self._values[key] = self._present(key, field, surplus.pop(key))
            elif key in surplus:
                self._values[key] = default_of(field)
            else:
                self._values[key] = self._absent(key, field, is_needed=applies is True)
        if not self._has_plugin:
            for key in surplus:
                self._problems.add((*self._keys, str(key)), self._unknown(key))
            surplus = {}
        self._check_joints()
        values = {field.name: self._values[key] for key, (field, _) in self._fields.items()}
        return values | dict.fromkeys(self._own, surplus)

    def _absent(self, key: str, field: structs.FieldInfo, *, is_needed: bool) -> Any:
        if field.required:
            self._wrong.add(key)
            if is_needed and not self._problems.has((*self._keys, key)):
                self._problems.add(self._keys, f"the key {key!r} is missing")
        return default_of(field)

    def _present(self, key: str, field: structs.FieldInfo, data: Any) -> Any:
        before = len(self._problems)
        at = self._keys if key == self._short else (*self._keys, key)
        value = self._reader.value(field.type, data, at)
        if len(self._problems) == before:
            return value
        self._wrong.add(key)
        # What is right in a map is kept; a participant without outputs would be a second problem.
        is_kept = field.required or isinstance(value, msgspec.Struct | dict)
        return value if is_kept else default_of(field)

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
        return f"unknown key {key!r}{f'; {place}' if place else suggest(key, self._fields)}"

    def _check_joints(self) -> None:
        """Add what does not fit `joints` among the numbers that are one for each of them."""
        joints = self._values.get("joints") or ()
        for key, value in self._values.items() if joints else ():
            if isinstance(value, PerName) and key in self._given:
                for at, text in value.misfits(joints):
                    self._problems.add((*self._keys, key, *at), text)
