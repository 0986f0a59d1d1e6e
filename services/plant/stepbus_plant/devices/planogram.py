"""The planogram: where things belong, as far as the shop knows that without looking."""

import math
from collections.abc import Mapping

from stepbus_plant.world.stock import Item
from stepbus_schemas import Point, Poses, Quaternion

PORT = "planogram"
"""Name of an output of type Poses/1 that carries it, instead of the true poses."""

_CENTIMETRE = 0.01


def planogram(names: list[str], poses: Poses, items: Mapping[str, Item]) -> Poses:
    """Return where links belong: items in their slots, to the centimetre; all else as surveyed.

    names: of the links. poses: the true ones before the run. items: by the name of their link.
    """
    rows = zip(names, poses.position, poses.orientation, strict=True)
    found = [_slot(items[name]) if name in items else (at, turn) for name, at, turn in rows]
    return Poses(position=[at for at, _ in found], orientation=[turn for _, turn in found])


def _slot(item: Item) -> tuple[Point, Quaternion]:
    x, y = (round(value / _CENTIMETRE) * _CENTIMETRE for value in item.slot[:2])
    half = item.slot_yaw / 2
    return (x, y, item.slot[2]), (0.0, 0.0, math.sin(half), math.cos(half))
