"""Compares plain values: numbers, texts, lists, maps."""

import math
from collections.abc import Iterator
from typing import Any

import msgspec

from .tolerance import FieldTolerance

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
        yield Difference(path, one, other, not _allowed(one, other, tolerance))


def difference(one: Any, other: Any) -> float | None:
    """Return |one − other| of two numbers; None where that is not a number."""
    if not (_is_number(one) and _is_number(other)):
        return None
    found = abs(float(one) - float(other))
    return None if math.isnan(found) else found


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


def _allowed(one: Any, other: Any, tolerance: FieldTolerance | None) -> bool:
    if tolerance is None:
        return False
    if _is_number(one) and _is_number(other):
        return tolerance.allows(one, other)
    return tolerance.ignore


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
