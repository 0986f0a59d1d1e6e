"""The types of a field: what data each takes, and what it is called in a sentence."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec
from msgspec import structs

from stepbus_schemas import listed, nearest

from .kinds import PerName
from .problems import show

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
_REACHED = 1e18
_NUMBER = re.compile(r"[-+]?[0-9]+\.?[0-9]*([eE][-+]?[0-9]+)? *\D{0,12}")


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


def options_of(wanted: Any) -> tuple[Any, ...]:
    """Return the types that a value may have."""
    bare, _ = unmarked(wanted)
    return get_args(bare) if get_origin(bare) in (Union, UnionType) else (wanted,)


@cache
def fields_of(settings: Any) -> dict[str, tuple[structs.FieldInfo, dict[str, Any]]]:
    """Return key → field, and what its marks say; a field is behind those that it depends on."""
    rows = {f.encode_name: (f, unmarked(f.type)[1]) for f in structs.fields(settings)}
    return dict(sorted(rows.items(), key=lambda row: "when" in row[1][1]))


def default_of(field: structs.FieldInfo) -> Any:
    """Return the default of a field, or what stands for a required one."""
    if field.required:
        return forms_of(field.type)[0].empty
    if field.default is not msgspec.NODEFAULT:
        return field.default
    return field.default_factory()


@dataclass(frozen=True)
class Form:
    """One type of a value.

    wanted: as it is declared. type, arguments: `tuple` and `(float, float)`. marks: what its marks
    say. is_per_name: the value is one for each joint.
    """

    wanted: Any
    type: Any
    arguments: tuple[Any, ...]
    marks: Mapping[str, Any]
    is_per_name: bool = False

    @property
    def is_struct(self) -> bool:
        """Return whether it is another class of settings."""
        return isinstance(self.type, type) and issubclass(self.type, msgspec.Struct)

    @property
    def is_fixed(self) -> bool:
        """Return whether it is a list of a fixed length, such as `tuple[float, float]`."""
        return self.type is tuple and self.arguments[-1] is not ...

    @property
    def empty(self) -> Any:
        """Return what stands for a value that is wrong or missing."""
        if self.is_struct:
            fields = structs.fields(self.type)
            return self.type(**{f.name: default_of(f) for f in fields if f.required})
        return self.type() if self.type in _NOUNS else None

    def takes(self, data: Any) -> bool:
        """Return whether data is of this type, but for what a map or a list holds."""
        if "read" in self.marks:
            return isinstance(data, str) and data != "" and "\0" not in data
        if self.is_struct:
            is_short = isinstance(data, str) and bool(self.type.short)
            return data is None or isinstance(data, Mapping | self.type) or is_short
        if self.type is dict:
            return isinstance(data, Mapping)
        if self.type in (list, tuple):
            return isinstance(data, list | tuple) and self._has_length(len(data))
        try:
            msgspec.convert(data, self.wanted)
        except msgspec.ValidationError:
            return False
        return True

    def _has_length(self, length: int) -> bool:
        if self.is_fixed:
            return length == len(self.arguments)
        least: int = self.marks.get("min_length", 0)
        return length >= least

    @property
    def noun(self) -> str:
        """Return what it is called: `a number above 0`, `an integer from 1 to 9`."""
        if "description" in self.marks:
            return str(self.marks["description"])
        if self.is_struct:
            return "text or a map" if self.type.short else "a map"
        if self.is_fixed:
            return f"a list of {len(self.arguments)} values"
        noun = _NOUNS.get(self.type, "something else")
        limits = {n: self.marks[n] for n in _LIMITS if abs(self.marks.get(n, math.inf)) < _REACHED}
        if "ge" in limits and "le" in limits:
            return f"{noun} from {limits['ge']:g} to {limits['le']:g}"
        return " ".join([noun, *(f"{_LIMITS[name]} {limit:g}" for name, limit in limits.items())])


def forms_of(wanted: Any) -> tuple[Form, ...]:
    """Return the types that a value may have; those of a number for each joint are three."""
    bare, marks = unmarked(wanted)
    if bare is PerName:
        return tuple(replace(form, is_per_name=True) for form in forms_of(marks["values"]))
    options = options_of(wanted)
    if options != (wanted,):
        return tuple(form for option in options for form in forms_of(option))
    return (Form(wanted, get_origin(bare) or bare, get_args(bare), marks),)


def mistake(forms: Sequence[Form], data: Any) -> str:
    """Return what is wrong with data that has none of some forms: what is right, and a hint."""
    words = [word for form in forms if form.type is Literal for word in form.arguments]
    types = [form.type for form in forms]
    others = [form.noun for form in forms if form.type not in (Literal, NoneType)]
    hint = ""
    if isinstance(data, int | float) and str in types:
        hint = "; put it in quotes"
    elif isinstance(data, str) and words:
        hint = nearest(data, words)
    elif isinstance(data, str) and {int, float} & set(types) and _NUMBER.fullmatch(data):
        hint = "; write only the number, without quotes and unit; angles are in radians"
    return f"must be {listed([*words, *others])}, not {show(data)}{hint}"
