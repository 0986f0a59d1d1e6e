"""Axes of a sweep: which values of a scenario vary, and over what.

An axis is one text, on the command line as in a sweep file:

    controller.params.kp=50:200:7                7 values from 50 to 200, ends included
    controller.params.kp=1:1000:4:log            4 values, equal ratios
    controller.params.law=pd_gravity,pid         a list, as YAML has it between [ and ]
    controller.params.kp=50,100 & controller.params.kd=10,20      together, pair by pair
    plant.params.mass~normal(1, 0.1)             drawn; SciPy's distributions by name
    controller.params.kp=50:200                  free, for an optimizer; also `…:log`
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_participant import SettingsError
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

from .distributions import Distribution, parse_distribution

_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_RANGE = re.compile(rf"{_NUMBER}:{_NUMBER}(?::\s*(\d+)\s*)?(?::\s*(log|lin)\s*)?")
_MOST_VALUES = 100_000
FAULTS = "faults"
"""The axis whose values are faults to inject; `none`: no fault."""


@dataclass(frozen=True, kw_only=True)
class Span:
    """All numbers between two, for an optimizer; whole ones where both ends are."""

    low: float
    high: float
    is_log: bool = False
    is_whole: bool = False


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What varies together, and over what.

    paths: of the values, as `--set` has them. values: one row a point, one value a path; none of
    an axis that is drawn or free. distribution: what its values are drawn from. span: what an
    optimizer chooses from.
    """

    text: str
    paths: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...] = ()
    distribution: Distribution | None = None
    span: Span | None = None


def parse_axis(text: str) -> Axis:
    """Return the axis that a text means; raises WiringError for one that means none."""
    parts = [_parse_one(part.strip(), text) for part in text.split(" & ")]
    if len(parts) == 1:
        return parts[0]
    if any(not part.values for part in parts):
        raise WiringError(f"{text}: only lists and ranges with a count vary together")
    lengths = {part.paths[0]: len(part.values) for part in parts}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{path} has {count}" for path, count in lengths.items())
        raise WiringError(f"{text}: values that vary together need the same number; {counts}")
    rows = zip(*(part.values for part in parts), strict=True)
    values = tuple(tuple(value for (value,) in row) for row in rows)
    return Axis(text=text, paths=tuple(part.paths[0] for part in parts), values=values)


def _parse_one(part: str, text: str) -> Axis:
    found = re.match(r"([\w.\-/ ]+?)\s*([=~])(.*)", part, re.DOTALL)
    if found is None or not found[3].strip():
        raise WiringError(
            f"{text}: write PATH=VALUES or PATH~DISTRIBUTION, e.g. controller.params.kp=50:200:7 "
            "or plant.params.mass~normal(1, 0.1)"
        )
    path, sign, rest = found[1], found[2], found[3].strip()
    if sign == "~":
        return Axis(text=text, paths=(path,), distribution=parse_distribution(rest, text))
    span = _RANGE.fullmatch(rest)
    if span is None:
        return Axis(text=text, paths=(path,), values=_listed(rest, text))
    return _ranged(path, span, text)


def _listed(rest: str, text: str) -> tuple[tuple[Any, ...], ...]:
    try:
        values = parse_yaml(text, f"[{rest}]")
    except SettingsError as exc:
        raise WiringError(f"{text}: the values are no list of YAML: {exc}") from exc
    if not values:
        raise WiringError(f"{text}: give at least one value")
    return tuple((value,) for value in values)


def _ranged(path: str, found: re.Match[str], text: str) -> Axis:
    low, high = float(found[1]), float(found[2])
    is_whole = all(re.fullmatch(r"[-+]?\d+", found[n]) for n in (1, 2))
    is_log = found[4] == "log"
    if is_log and not (low > 0 and high > 0):
        raise WiringError(f"{text}: a logarithmic range lies above 0")
    if found[3] is None:
        if not low < high:
            raise WiringError(f"{text}: the range starts below its end")
        span = Span(low=low, high=high, is_log=is_log, is_whole=is_whole)
        return Axis(text=text, paths=(path,), span=span)
    count = int(found[3])
    if not 0 < count <= _MOST_VALUES:
        raise WiringError(f"{text}: a range has 1 to {_MOST_VALUES} values, not {count}")
    numbers = np.geomspace(low, high, count) if is_log else np.linspace(low, high, count)
    return Axis(text=text, paths=(path,), values=_numbers(numbers.tolist(), is_whole=is_whole))


def _numbers(values: Sequence[float], *, is_whole: bool) -> tuple[tuple[Any, ...], ...]:
    """Return numbers as values: whole ones where all are, and the ends are written so."""
    if is_whole and all(math.isclose(value, round(value), abs_tol=1e-9) for value in values):
        return tuple((round(value),) for value in values)
    return tuple((value,) for value in values)
