"""Finds items that lie: what has their colour and no upright item explains."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from stepbus_store.perception.detection import Detection
from stepbus_store.perception.faces import Mask, Scene
from stepbus_store.perception.images import Vector, rotation, turn_about_z
from stepbus_store.perception.item_catalog import MARGIN, ItemType

_FEWEST_PIXELS = 60
_LONGER = 1.15
"""By this factor longer than it is wide, what is seen cannot stand upright."""
_LONGEST = 1.3
"""By this factor longer than the item, it is something else."""
_TOP = 98
"""Percentile of the heights that counts as the top, since there is noise."""
_NOISE = 0.05
"""Share of the surroundings that may be lower than that by mistake."""
_FEW, _SIDES = 5, 3
"""Pixels on one of four sides, and sides, that have to show the ground that it would reach into."""
_APART, _RING = 4e-3, 0.02
"""Distances from an item between which its surroundings are looked at [m]."""
_NEAR = 0.15
"""Half the side of the square around an item in which they are [m]."""
_DEEP = 0.015
"""By more, an item does not reach into the ground [m]."""


def is_sunk(scene: Scene, others: Mask, item: Detection, item_type: ItemType) -> bool:
    """Return whether an upright item would reach into the surfaces all around it.

    What lies shows faces that may pass for those of an item that stands, and is too low for that.
    others: pixels of another colour, shape (h, w).
    """
    near = scene.flat_near(others, item.position, _NEAR)
    away = _beyond(item, item_type, near)
    around = near[(away > _APART) & (away < _RING)] - item.position
    tall = item_type.faces[0].offset[2] - item_type.centre[2]
    depth = around[:, 2] + tall
    if (depth < _DEEP).sum() > _NOISE * len(depth):
        return False
    between = around[(depth > _DEEP) & (depth < 2 * tall - _DEEP)]
    _, pixels = np.unique(between[:, :2] > 0.0, axis=0, return_counts=True)
    return int((pixels >= _FEW).sum()) >= _SIDES


def _covers(item: Detection, item_type: ItemType, points: Vector) -> Mask:
    """Return which points, shape (n, 3) [m], are of an upright item, or under it."""
    covered: Mask = _beyond(item, item_type, points) < MARGIN
    return covered


def _beyond(item: Detection, item_type: ItemType, points: Vector) -> Vector:
    """Return how far beside an upright item points are, shape (n, 3) [m]; below 0: over it."""
    axes = rotation(turn_about_z(item.yaw))
    local = (points - item.position) @ axes + item_type.centre
    beyond: Vector = np.min([face.beyond(local[:, :2]) for face in item_type.faces], axis=0)
    return beyond


def lying(
    scene: Scene, among: Mask, types: Sequence[ItemType], upright: Sequence[Detection]
) -> Iterator[Detection]:
    """Yield the items that lie within a mask, shape (h, w), of the colour of some types."""
    rows, columns, points = scene.points(among)
    free = np.ones(len(points), dtype=bool)
    by_name = {item_type.name: item_type for item_type in types}
    for item in upright:
        free &= ~_covers(item, by_name[item.type], points)
    left = np.zeros(among.shape, dtype=np.uint8)
    left[rows[free], columns[free]] = 1
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(left, connectivity=8)
    own = labels[rows, columns]
    height, width = among.shape
    for number, (x, y, wide, high, pixels) in enumerate(boxes.tolist()):
        # What reaches the rim may be the visible part of anything.
        is_whole = x > 0 and y > 0 and x + wide < width and y + high < height
        if number and is_whole and pixels >= _FEWEST_PIXELS:
            found = _fitting(points[free & (own == number)], types)
            if found is not None:
                yield found


def _fitting(points: Vector, types: Sequence[ItemType]) -> Detection | None:
    """Return the item that lies where points are, shape (n, 3) [m]; None: it is none of them."""
    flat = points[:, :2]
    spread = np.linalg.eigh(np.cov((flat - flat.mean(axis=0)).T))
    axis = spread.eigenvectors[:, -1]
    along, across = flat @ axis, flat @ (-axis[1], axis[0])
    length, width = float(np.ptp(along)), float(np.ptp(across))
    for item_type in types:
        top, centre = item_type.faces[0].offset[2], item_type.centre[2]
        tall, thick = 2.0 * (top - centre), 2.0 * max(f.outline.reach for f in item_type.faces)
        if _LONGER * max(thick, width) < length < _LONGEST * tall:
            middle = axis * (along.max() + along.min()) / 2
            middle = middle + np.array([-axis[1], axis[0]]) * (across.max() + across.min()) / 2
            z = float(np.percentile(points[:, 2], _TOP)) - width / 2
            return Detection(
                type=item_type.name,
                position=(float(middle[0]), float(middle[1]), z),
                yaw=math.atan2(axis[1], axis[0]),
                confidence=min(1.0, length / tall),
                lies=True,
            )
    return None
