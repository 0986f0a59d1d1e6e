"""The types of parameters, and the marks of their keys."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

import msgspec

from stepbus_participant.files import find_file
from stepbus_schemas import WiringError, suggest

from .durations import parse_duration
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
]

_DURATION = r"^[0-9.]+(/[0-9]+)? *(ns|us|µs|μs|ms|s|min|h)$"
_T = TypeVar("_T")
_PerName: TypeAlias = _T | tuple[_T, ...] | dict[str, _T]
NAME_FORM = "[A-Za-z0-9][A-Za-z0-9_-]{0,63}"


@dataclass(frozen=True)
class PerName:
    """One number for all joints, a list with one per joint, or a map by joint; see `of`.

    keys: path of the value, for error messages.
    """

    value: float | Sequence[float] | Mapping[str, float]
    keys: Keys = field(default=(), compare=False)

    def of(self, names: Sequence[str]) -> list[float]:
        """Return one number per name; raises SettingsError if the value does not fit the names."""
        problems = Problems()
        for keys, text in self.misfits(names):
            problems.add((*self.keys, *keys), text)
        problems.refuse()
        value = self.value
        if isinstance(value, Mapping):
            return [value[name] for name in names]
        return list(value) if isinstance(value, Sequence) else [value] * len(names)

    def misfits(self, names: Sequence[str]) -> Iterator[tuple[Keys, str]]:
        """Yield (keys, message) for each mismatch between the numbers and the names."""
        value = self.value
        if isinstance(value, Mapping):
            for name in value:
                if name not in names:
                    yield (name,), f"unknown joint {name!r}{suggest(name, names)}"
            for name in names:
                if name not in value:
                    yield (), f"joint {name!r} is missing"
        elif isinstance(value, Sequence) and len(value) != len(names):
            yield (), f"has {len(value)} numbers for {len(names)} joints ({', '.join(names)})"


def each(value: float) -> PerName:
    """Return a default: the same number for every joint."""
    return PerName(value)


def _find(name: str, folder: Path | None) -> Path:
    if folder is None:
        return Path(name)
    path = find_file(name, folder)
    if path.is_dir():
        raise WiringError(f"{name!r} is a folder ({path})")
    return path


def _find_model(name: str, folder: Path | None) -> Path:
    path = _find(name, folder)
    if folder is not None:
        # By name: this package reads no robots, and few participants need one.
        import_module("stepbus_models").read_robot(path)
    return path


def _duration(text: str, _folder: Path | None, *, may_be_zero: bool = False) -> int:
    return parse_duration(text, may_be_zero=may_be_zero)


def _distinct(names: tuple[str, ...], _folder: Path | None) -> tuple[str, ...]:
    twice = [repr(name) for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise WiringError(f"names {', '.join(twice)} twice")
    return names


def _written(title: str, noun: str, read: object, **schema: object) -> msgspec.Meta:
    """Return the mark of a type that `read(text, folder)` makes from a text."""
    return msgspec.Meta(
        title=title,
        extra={"of": Annotated[str, msgspec.Meta(min_length=1, description=noun)], "read": read},
        extra_json_schema={"type": "string", **schema},
    )


def _per_name(values: object) -> msgspec.Meta:
    """Return the mark of a `PerName`; values: the type of its numbers, lists and maps."""
    return msgspec.Meta(extra={"of": values, "read": None})


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
Text = Annotated[str, msgspec.Meta(min_length=1, description="text that is not empty")]
"""A non-empty string, such as the name of a link."""
Name = Annotated[
    str,
    msgspec.Meta(
        title="name",
        description="a name of 1 to 64 letters, digits, '_' and '-', "
        "starting with a letter or digit",
        pattern=rf"^{NAME_FORM}\Z",
        extra_json_schema={"pattern": f"^{NAME_FORM}$"},
    ),
]
"""Name of a scenario, a participant or a port."""
Duration = Annotated[
    int, _written("duration", "a duration with a unit, e.g. 5ms", _duration, pattern=_DURATION)
]
"""`5ms`, `0.005s` or `1/200s`; the field holds it in [ns] and has the suffix `_ns`."""
Pause = Annotated[
    int,
    _written(
        "duration, or `0s`",
        "a duration with a unit, e.g. 5ms",
        partial(_duration, may_be_zero=True),
        pattern=_DURATION,
    ),
]
"""Like `Duration`, but may be zero: `0s`."""
File = Annotated[Path, _written("file", "a file name", _find)]
"""A file: absolute, `package://…`, or relative to the scenario or file that names it."""
ModelFile = Annotated[Path, _written("file", "a file name", _find_model)]
"""A robot's URDF, `.xacro` or MJCF, named like a `File`; its physics is validated."""
Names = Annotated[
    tuple[Text, ...],
    msgspec.Meta(
        title="list of names",
        extra={
            "of": Annotated[
                tuple[Text, ...],
                msgspec.Meta(min_length=1, description="a list of one or more names"),
            ],
            "read": _distinct,
        },
        extra_json_schema={"minItems": 1, "uniqueItems": True},
    ),
]
"""Distinct names, at least one."""
Plugin = Annotated[
    str,
    msgspec.Meta(
        title="`file.py:Class`",
        description="file.py:Class",
        pattern=":",
        extra_json_schema={"pattern": r"^([\w.]+|.+\.py):\w+$"},
    ),
]
"""Your own class, `file.py:Class` or `module:Class`; undeclared keys become its parameters."""
Own = Annotated[dict[str, Any], msgspec.Meta(extra={"own": True})]
"""Collects the parameters of your own class."""
PerJoint = Annotated[PerName, _per_name(_PerName[Finite])]
"""One number for all `joints`, a list with one per joint, or a map by joint."""
NonNegativePerJoint = Annotated[PerName, _per_name(_PerName[NonNegative])]
"""Like `PerJoint`, each number at least 0."""
PositivePerJoint = Annotated[PerName, _per_name(_PerName[Positive])]
"""Like `PerJoint`, each number positive."""
