"""Whether values are equal: to the bit, or within the tolerance that the user gives a field."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import msgspec

from stepbus_participant import NonNegative, Settings, suggest
from stepbus_participant.parameters import read, read_yaml
from stepbus_schemas import WiringError

ANY = "*"
"""Stands for every port, or for every field of a port."""
_SHOWN_CHARACTERS = 300


class Difference(msgspec.Struct, frozen=True):
    """Two values that are not equal to the bit. beyond: whether the tolerance excludes it."""

    path: str
    first: Any
    second: Any
    beyond: bool


def differences(
    path: str, one: Any, other: Any, tolerance: FieldTolerance | None
) -> Iterator[Difference]:
    """Yield every pair of values that are not equal to the bit, with the index of each.

    tolerance: None: each of them is beyond it.
    """
    if isinstance(one, dict) and isinstance(other, dict):
        for key in dict.fromkeys((*one, *other)):
            yield from differences(f"{path}.{key}", one.get(key), other.get(key), tolerance)
    elif _is_array(one) and _is_array(other) and len(one) == len(other):
        for index, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from differences(f"{path}[{index}]", a, b, tolerance)
    elif not _same(one, other):
        beyond = tolerance is None or not tolerance.allows(one, other)
        yield Difference(path, one, other, beyond)


def difference(one: Any, other: Any) -> float | None:
    """Return |one − other| of two numbers; None where that is not a number."""
    if not (_is_number(one) and _is_number(other)):
        return None
    gap = abs(float(one) - float(other))
    return None if math.isnan(gap) else gap


def short(value: Any) -> str:
    """Return a value as text that fits into a line or two."""
    text = repr(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}…"


def _is_array(value: Any) -> bool:
    # A point or a quaternion is a tuple.
    return isinstance(value, list | tuple)


def _same(one: Any, other: Any) -> bool:
    """Return whether two values are equal to the bit, any two NaN included."""
    if isinstance(one, float) and isinstance(other, float):
        if math.isnan(one):
            return math.isnan(other)
        return one == other and math.copysign(1.0, one) == math.copysign(1.0, other)
    return type(one) is type(other) and bool(one == other)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


class FieldTolerance(Settings):
    """How far two values of one field may differ: |a − b| ≤ abs + rel · |a|, a the recorded."""

    abs: NonNegative = 0.0
    """[the field's unit]"""
    rel: NonNegative = 0.0
    """[-]"""
    ignore: bool = False
    """Any two values are equal."""

    def allows(self, recorded: Any, other: Any) -> bool:
        """Return whether two values that differ count as equal; an infinity equals only itself."""
        if self.ignore or not (_is_number(recorded) and _is_number(other)):
            return self.ignore
        gap = difference(recorded, other)
        if recorded == other or gap is None or math.isinf(gap):
            return bool(recorded == other)
        return gap <= self.abs + self.rel * math.fabs(recorded)


@dataclass(frozen=True)
class Tolerance:
    """Tolerances by (topic such as `controller/command`, field); `*` for any.

    Anything without a tolerance must be byte-identical. The most specific entry applies: an exact
    topic before `*`, then an exact field before `*`.
    """

    rules: Mapping[tuple[str, str], FieldTolerance] = field(default_factory=dict)

    def of(self, topic: str, name: str) -> FieldTolerance | None:
        """Return the tolerance of a field; None if it must be identical."""
        keys = ((topic, name), (topic, ANY), (ANY, name), (ANY, ANY))
        return next((self.rules[key] for key in keys if key in self.rules), None)

    def concerns(self, topic: str) -> bool:
        """Return whether any field of a topic has a tolerance."""
        return any(named in {topic, ANY} for named, _ in self.rules)

    def __or__(self, other: Tolerance) -> Tolerance:
        """Return both together; where both name a field, the abs and rel of `other` hold."""
        return Tolerance({**self.rules, **other.rules})

    def check(self, fields: Mapping[str, Sequence[str]]) -> None:
        """Raise WiringError for every topic and field that does not exist. fields: by topic."""
        mistakes: list[str] = []
        for topic, name in self.rules:
            if topic not in {*fields, ANY}:
                near = suggest(topic, fields)
                mistakes.append(f"tolerance: no port {topic!r} in the recording{near}")
                continue
            known = fields[topic] if topic != ANY else [n for own in fields.values() for n in own]
            if name not in {*known, ANY}:
                where = "in any channel" if topic == ANY else f"in {topic}"
                mistakes.append(f"tolerance: no field {name!r} {where}{suggest(name, known)}")
        if mistakes:
            raise WiringError("\n".join(mistakes))


AnyTolerance = float | Mapping[str, float] | str | PathLike[str] | Tolerance | None
"""An absolute tolerance for all, or by `PORT[.FIELD]`; a YAML file; None: equal to the byte."""


def tolerance_of(given: AnyTolerance, participant: str = "") -> Tolerance:
    """Return a tolerance; raises WiringError when it is none. participant: of bare port names."""
    match given:
        case None:
            return Tolerance()
        case Tolerance():
            return given
        case float() | int():
            return parse_tolerance([str(given)], (), (), participant)
        case Mapping():
            limits = [f"{field}={value}" for field, value in given.items()]
            return parse_tolerance(limits, (), (), participant)
        case _:
            return read_tolerance(Path(given))


_Row = Literal["ignore"] | FieldTolerance


def read_tolerance(path: Path) -> Tolerance:
    """Read a YAML file such as `controller/command: {values: {abs: 1e-9}, mode: ignore}`.

    Raises SettingsError that lists every mistake with its line.
    """
    file = read_yaml(path, "a tolerance file must map topics to fields")
    problems = file.problems()
    topics: dict[str, Literal["ignore"] | dict[str, _Row]] = read(
        dict[str, Literal["ignore"] | dict[str, _Row]], file.data, problems
    )
    problems.refuse()
    return Tolerance(
        {
            (topic, name): FieldTolerance(ignore=True) if isinstance(row, str) else row
            for topic, fields in topics.items()
            for name, row in ({ANY: fields} if isinstance(fields, str) else fields).items()
        }
    )


def parse_tolerance(
    absolute: Iterable[str], relative: Iterable[str], ignored: Iterable[str], participant: str = ""
) -> Tolerance:
    """Return the tolerance of command line options such as `command.values=1e-9`.

    absolute, relative: `[PORT[.FIELD]=]NUMBER`. ignored: `PORT[.FIELD]`. A port is a topic such as
    `controller/command`, or a port of `participant`. Raises WiringError for one that is not valid.
    """
    limits: dict[tuple[str, str], dict[str, Any]] = {}
    for option, settings in (("abs", absolute), ("rel", relative)):
        for setting in settings:
            target, _, number = setting.rpartition("=")
            value = _parsed(f"--{option} {setting}", number)
            limits.setdefault(_target(target, participant), {})[option] = value
    rules = {key: FieldTolerance(**limit) for key, limit in limits.items()}
    rules |= {_target(target, participant): FieldTolerance(ignore=True) for target in ignored}
    return Tolerance(rules)


def _parsed(option: str, number: str) -> float:
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf:
        raise WiringError(
            f"{option}: {number!r} is not a finite number ≥ 0; "
            "write [PORT[.FIELD]=]NUMBER, e.g. command.values=1e-9"
        )
    return value


def _target(text: str, participant: str) -> tuple[str, str]:
    port, _, name = text.partition(".")
    topic = port if "/" in port or not participant else f"{participant}/{port}"
    return (topic if port else ANY), name or ANY
