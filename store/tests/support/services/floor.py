"""Boxes on a floor, and what a lidar measures of them."""

import math
import random

import numpy as np

from stepbus_schemas import BaseState, LaserScan
from stepbus_store.planner.lidar_view import SEEN
from stepbus_store.planner.outline import Outline

HALF = 0.15
RAYS = 181


def box(x, y):
    """Return the outline of a box of 0.3 m with its middle there [m]."""
    sides = [(-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF)]
    return Outline(link=SEEN, corners=np.array([(x + a, y + b) for a, b in sides]))


def scan_of(boxes, base: BaseState, mount, noise=0.0):
    """Return the scan of a lidar on a base among boxes, each x, y of its middle [m]."""
    chance = random.Random(1)
    c, s = math.cos(base.yaw), math.sin(base.yaw)
    x, y = base.x + c * mount[0] - s * mount[1], base.y + s * mount[0] + c * mount[1]
    step = math.pi / (RAYS - 1)
    ranges = []
    for ray in range(RAYS):
        angle = base.yaw + mount[2] - math.pi / 2 + ray * step
        hits = [far for at in boxes if (far := _hit(x, y, angle, at)) is not None]
        nearest = min(hits, default=math.inf)
        ranges.append(nearest + chance.gauss(0.0, noise) if nearest < 4.0 else math.inf)
    return LaserScan(
        angle_min=-math.pi / 2,
        angle_increment=step,
        range_min=0.05,
        range_max=4.0,
        ranges=ranges,
    )


def _hit(x, y, angle, at):
    """Return how far along a ray a box is (slab method); None: it is not hit."""
    near, far = 0.0, math.inf
    for origin, way, middle in ((x, math.cos(angle), at[0]), (y, math.sin(angle), at[1])):
        if abs(way) < 1e-12:
            if abs(origin - middle) > HALF:
                return None
            continue
        ends = sorted(((middle - HALF - origin) / way, (middle + HALF - origin) / way))
        near, far = max(near, ends[0]), min(far, ends[1])
    return near if near <= far else None
