"""Collision shapes, as the detail `shape` of a description of Poses/1 writes them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .messages import Point, Quaternion

_SIZES = {"box": 3, "capsule": 2, "cylinder": 2, "sphere": 1}
_ORIGIN = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@dataclass(frozen=True)
class Shape:
    """One collision shape in the frame of its link.

    type: `box`, `capsule`, `cylinder`, `sphere`, or the word for one without sizes, such as `mesh`.
    sizes: X Y Z of a box, RADIUS LENGTH of a capsule or cylinder, RADIUS of a sphere [m].
    position: x, y, z [m]. orientation: quaternion x, y, z, w.
    """

    type: str
    sizes: tuple[float, ...]
    position: Point
    orientation: Quaternion


def parse_shapes(text: str) -> list[Shape]:
    """Return the shapes of a text such as `sphere 0.1 @ 0 0 0 0 0 0 1; mesh`.

    A shape without a pose is at the origin of its link. Raises ValueError for sizes that are
    missing or not positive, and for a pose that is not finite.
    """
    return [_parse(part.strip()) for part in text.split(";") if part.strip()]


def _parse(text: str) -> Shape:
    form, _, pose = text.partition("@")
    name, *sizes = form.split() or [""]
    numbers, at = _numbers(sizes), _numbers(pose.split()) or _ORIGIN
    is_sized = name not in _SIZES or (len(numbers) == _SIZES[name] and min(numbers) > 0)
    if not is_sized or len(at) != len(_ORIGIN) or not any(at[3:]):
        raise ValueError(f"cannot parse shape {text!r}; sizes must be positive, poses finite")
    x, y, z, qx, qy, qz, qw = at
    return Shape(name, tuple(numbers), (x, y, z), (qx, qy, qz, qw))


def _numbers(words: Sequence[str]) -> list[float]:
    """Return words as numbers; a NaN alone if one of them is not finite."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return [math.nan]
    return numbers if all(map(math.isfinite, numbers)) else [math.nan]
