"""What the lidars of a base see that is on no map, and whether it is in the way of a route."""

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import BaseState, LaserScan, Point
from stepbus_store.planner.outline import Outline, distances, hull

_MAPPED = 0.12
"""Nearer than that to something on the map, a point is seen of that [m]."""

_APART = 0.15
"""Neighbours farther apart belong to two things [m]."""

_DEPTH = 0.2
"""How far what is seen reaches back from the face that the lidar sees [m]."""

_FEWEST = 2
"""Points that make a thing; a single one is noise."""

_SAME = 0.15
"""Nearer to where something was when the route was planned, it is the same thing [m]."""

_LATER = 0.25
"""How much more room is left to what was not there then: it may be moving [m]."""

_TOLERANCE = 0.04
"""By which less room than planned what was there may leave [m]."""

_AGO = 0.3
"""Over which time the velocity of a thing is measured [s]."""

_WALKS = 0.15
"""Velocity from which it moves [m/s]."""

_AHEAD = 1.5
"""For how long it is expected to move on like that [s]."""

_STRIDE = 0.1
"""Of the places along a route that are checked [m]."""

SEEN = "something that the lidar sees"


class LidarView:
    """The newest scan of each lidar, in the frame of odometry.

    mounts: name of the port → pose of the lidar in the base: x, y, yaw [m, rad].
    """

    def __init__(self, mounts: Mapping[str, Point]) -> None:
        self._mounts = mounts
        self._things: dict[str, list[tuple[Vector, Vector]]] = {}

    def take(self, port: str, scan: LaserScan, base: BaseState) -> None:
        """Take a scan, and where the base was [m, rad]."""
        x, y, yaw = self._mounts[port]
        cos, sin = math.cos(base.yaw), math.sin(base.yaw)
        at = np.array([base.x + cos * x - sin * y, base.y + sin * x + cos * y])
        ranges = np.array(scan.ranges)
        angles = base.yaw + yaw + scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        away = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._things[port] = list(_things(at, ranges, away))

    def snapshot(self) -> "LidarView":
        """Return the same view, which later scans do not change."""
        view = LidarView(self._mounts)
        view._things = dict(self._things)
        return view

    def things(self, mapped: Sequence[Outline]) -> list[Outline]:
        """Return outlines of all that is seen and not on the map."""
        seen = []
        for things in self._things.values():
            for points, away in things:
                low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
                is_new = np.ones(len(points), dtype=bool)
                for row in mapped:
                    if row.may_be_near(low, high, _MAPPED):
                        is_new &= distances(points, row.corners) > _MAPPED
                face = points[is_new]
                if len(face) >= _FEWEST:
                    behind = face + _DEPTH * away[is_new]
                    seen.append(Outline(link=SEEN, corners=hull(np.concatenate([face, behind]))))
        return seen


def _things(at: Vector, ranges: Vector, away: Vector) -> Iterator[tuple[Vector, Vector]]:
    """Yield the points of each thing, and the directions they are seen in, shape (n, 2) each."""
    valid = np.flatnonzero(np.isfinite(ranges))
    points = at + ranges[valid, None] * away[valid]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    cuts = np.flatnonzero((steps > _APART) | (np.diff(valid) > 2)) + 1
    for part in np.split(np.arange(len(valid)), cuts):
        if len(part) >= _FEWEST:
            yield points[part], away[valid[part]]


class RouteMonitor:
    """Watches a route for what comes into its way.

    request_id: of the route. route: its poses, the start first [m, rad]. known: what was seen when
    it was planned. half_width: of the room that it left, see `BasePlanner` [m].
    """

    def __init__(
        self,
        request_id: int,
        route: Sequence[Point],
        mapped: Sequence[Outline],
        known: Sequence[Outline],
        half_width: float,
    ) -> None:
        self.request_id = request_id
        self.mapped = mapped
        self._known = known
        self._half_width = half_width
        self._places = np.array(list(_along(route)))
        self._next = 0
        self._before: deque[tuple[float, Sequence[Outline]]] = deque()

    def check(self, things: Sequence[Outline], base: BaseState, t: float) -> str:
        """Return a sentence about what is in the way of the rest of the route; empty: nothing.

        What moves is where it is, and where it will be if it goes on. t: time [s].
        """
        here = np.array([base.x, base.y])
        ahead = self._places[self._next :]
        away = np.linalg.norm(ahead - here, axis=1)
        # The base goes on along the route, and does not jump to where it crosses itself.
        self._next += int(away[: round(1.0 / _STRIDE)].argmin())
        ahead = self._places[self._next :]
        while len(self._before) > 1 and self._before[1][0] <= t - _AGO:
            self._before.popleft()
        then, earlier = self._before[0] if self._before else (t, things)
        self._before.append((t, things))
        for thing in things:
            moves = _AHEAD * _velocity(thing, earlier, t - then)
            is_known = not moves.any() and any(
                (distances(thing.corners, row.corners) < _SAME).any() for row in self._known
            )
            room = self._half_width + (-_TOLERANCE if is_known else _LATER)
            swept = hull(np.concatenate([thing.corners, thing.corners + moves]))
            gaps = distances(ahead, swept)
            # To what is beside it, and no nearer ahead, it comes no closer.
            hits = np.flatnonzero(gaps < room)
            if len(hits) and gaps[hits].min() < gaps[0] - 1e-2:
                far = float(np.linalg.norm(ahead[gaps.argmin()] - here))
                return f"{thing.link} is {gaps.min():.2f} m from the route, {far:.1f} m ahead"
        return ""


def _velocity(thing: Outline, earlier: Sequence[Outline], seconds: float) -> Vector:
    """Return how fast a thing moves, shape (2,) [m/s]; 0: it does not, or it is new.

    Both of its sides have to move: more of a thing that stands is seen as the base goes by.
    """
    still = np.zeros(2)
    if seconds < _AGO / 2:
        return still
    near = [row for row in earlier if distances(thing.corners, row.corners).min() < 2 * _SAME]
    if not near:
        return still
    middle = thing.corners.mean(axis=0)
    before = min(near, key=lambda row: float(np.linalg.norm(row.corners.mean(axis=0) - middle)))
    low = thing.corners.min(axis=0) - before.corners.min(axis=0)
    high = thing.corners.max(axis=0) - before.corners.max(axis=0)
    both = np.where(low * high > 0.0, np.where(np.abs(low) < np.abs(high), low, high), 0.0)
    velocity: Vector = both / seconds
    return velocity if float(np.linalg.norm(velocity)) > _WALKS else still


def _along(route: Sequence[Point]) -> Iterator[tuple[float, float]]:
    """Yield places along a route, each at most a stride from the one before."""
    yield route[0][:2]
    for (ax, ay, _), (bx, by, _) in pairwise(route):
        count = max(math.ceil(math.hypot(bx - ax, by - ay) / _STRIDE), 1)
        for n in range(1, count + 1):
            yield ax + (bx - ax) * n / count, ay + (by - ay) * n / count
