"""The types of parameters, and the marks of their keys."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from stepbus_schemas import suggest

from .problems import Keys, Problems

__all__ = [
    "Count",
    "Duration",
    "File",
    "Finite",
    "ModelFile",
    "Name",
    "Names",
    "NonNegative",
    "NonNegativePerJoint",
    "PerJoint",
    "PerName",
    "Plugin",
    "Positive",
    "PositivePerJoint",
    "Share",
    "Text",
    "Vector3",
    "Whole",
    "each",
    "needed_when",
    "when",
]

_DURATION = r"^[0-9.]+(/[0-9]+)? *(ns|us|µs|μs|ms|s|min|h)$"
NAME_FORM = "[A-Za-z0-9][A-Za-z0-9_-]*"
LONGEST_NAME = 64


class PerName:
    """One number for all joints, a list with one per joint, or a map by joint; see `of`.

    value: a number, a list or a map. keys: its path, for error messages.
    """

    def __init__(
        self, value: float | Sequence[float] | Mapping[str, float], keys: Keys = ()
    ) -> None:
        self._value = value
        self._keys = keys

    def of(self, names: Sequence[str]) -> list[float]:
        """Return one number per name; raises SettingsError if the value does not fit the names."""
        problems = Problems()
        for keys, text in self.misfits(names):
            problems.add((*self._keys, *keys), text)
        problems.refuse()
        if isinstance(self._value, Mapping):
            return [self._value[name] for name in names]
        value = self._value
        return list(value) if isinstance(value, Sequence) else [value] * len(names)

    def misfits(self, names: Sequence[str]) -> Iterator[tuple[Keys, str]]:
        """Yield why the numbers do not fit the names."""
        value = self._value
        if isinstance(value, Mapping):
            for name in value:
                if name not in names:
                    yield (name,), f"unknown joint {name!r}{suggest(name, names)}"
            for name in names:
                if name not in value:
                    yield (), f"joint {name!r} is missing"
        elif isinstance(value, Sequence) and len(value) != len(names):
            yield (), f"has {len(value)} numbers for {len(names)} joints ({', '.join(names)})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PerName) and other._value == self._value

    def __hash__(self) -> int:
        return hash(repr(self._value))

    def __repr__(self) -> str:
        return f"each({self._value!r})"


def each(value: float) -> PerName:
    """Return a default: the same number for every joint."""
    return PerName(value)


def when(**values: str | bool | tuple[str, ...]) -> msgspec.Meta:
    """Return a mark: the key applies only if other keys have these values.

    `Annotated[Positive, when(smoothing="low_pass")]` is then required, unless it has a default,
    and rejected otherwise.
    """
    wanted = {key: value if isinstance(value, tuple) else (value,) for key, value in values.items()}
    return msgspec.Meta(extra={"when": wanted})


def needed_when(**values: str | bool | tuple[str, ...]) -> msgspec.Meta:
    """Return a mark like `when`, for a key that is ignored with other values, not rejected."""
    marked = when(**values)
    return msgspec.Meta(extra={**(marked.extra or {}), "ignored": True})


def _text_form(mark: str, pattern: str) -> msgspec.Meta:
    schema = {"type": "string", "pattern": pattern}
    return msgspec.Meta(extra={"read": mark}, extra_json_schema=schema)


Finite = Annotated[float, msgspec.Meta(ge=-1e300, le=1e300)]
"""A finite number."""
NonNegative = Annotated[float, msgspec.Meta(ge=0, le=1e300)]
"""A finite number, at least 0."""
Positive = Annotated[float, msgspec.Meta(gt=0, le=1e300)]
"""A positive finite number."""
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
"""A number from 0 to 1."""
Count = Annotated[int, msgspec.Meta(ge=1, le=2**63 - 1)]
"""A whole number, at least 1."""
Whole = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""A whole number, at least 0."""
Vector3 = tuple[Finite, Finite, Finite]
"""Three finite numbers."""
Text = Annotated[str, msgspec.Meta(min_length=1)]
"""A non-empty string, such as the name of a link."""
Name = Annotated[str, _text_form("name", f"^{NAME_FORM}$"), msgspec.Meta(max_length=LONGEST_NAME)]
"""Name of a scenario, a participant or a port."""
Duration = Annotated[int, _text_form("duration", _DURATION)]
"""`5ms`, `0.005s` or `1/200s`; the field holds it in [ns] and has the suffix `_ns`."""
Pause = Annotated[int, _text_form("pause", _DURATION)]
"""Like `Duration`, but may be zero: `0s`."""
File = Annotated[Path, msgspec.Meta(extra={"read": "file"}, extra_json_schema={"type": "string"})]
"""A file: absolute, `package://…`, or relative to the scenario or file that names it."""
ModelFile = Annotated[
    Path, msgspec.Meta(extra={"read": "model"}, extra_json_schema={"type": "string"})
]
"""A robot's URDF, `.xacro` or MJCF, named like a `File`; its physics is validated."""
Names = Annotated[tuple[Text, ...], msgspec.Meta(min_length=1, extra={"read": "names"})]
"""Distinct names, at least one."""
Plugin = Annotated[str, msgspec.Meta(extra={"read": "plugin"})]
"""Your own class, `file.py:Class` or `module:Class`; undeclared keys become its parameters."""
Own = Annotated[dict[str, Any], msgspec.Meta(extra={"read": "own"})]
"""Collects the parameters of your own class."""


def _per(item: object) -> msgspec.Meta:
    return msgspec.Meta(extra={"read": "per_name", "item": item})


PerJoint = Annotated[PerName, _per(Finite)]
"""One number for all `joints`, a list with one per joint, or a map by joint."""
NonNegativePerJoint = Annotated[PerName, _per(NonNegative)]
"""Like `PerJoint`, each number at least 0."""
PositivePerJoint = Annotated[PerName, _per(Positive)]
"""Like `PerJoint`, each number positive."""
