"""What the lidars of a base see that is on no map, and whether it is in the way of a route."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import BaseState, LaserScan, Point
from stepbus_store.planner.outline import Outline, distances, hull
from stepbus_store.planner.params import Params
from stepbus_store.planner.walkers import STRIDE, Walkers, braking, going, places_along

_MAPPED = 0.12
"""Nearer than that to something on the map, a point is seen of that [m]."""

_APART = 0.15
"""Neighbours farther apart belong to two things [m]."""

_DEPTH = 0.3
"""How far what is seen reaches back from the face that the lidar sees, if it is that wide [m]."""

_FEWEST = 2
"""Points that make a thing; a single one is noise."""

_SAME = 0.15
"""Nearer to where something was when the route was planned, it is the same thing [m]."""

_LATER = 0.05
"""How much more room is left to what was not there then [m]."""

_TOLERANCE = 0.06
"""By which less room than planned what was there may leave [m]."""

_SURE = 6
"""Looks in a row that see through where something was, until it has gone."""

_DETOUR, _BEYOND = 0.7, 0.1
"""How much longer than straight a way is that is worth a new one, and how far beyond a place a ray
has to go that sees through it [m]."""

SEEN = "something that the lidar sees"


class LidarView:
    """The newest scan of each lidar, in the frame of odometry.

    mounts: name of the port → pose of the lidar in the base: x, y, yaw [m, rad].
    """

    def __init__(self, mounts: Mapping[str, Point]) -> None:
        self._mounts = mounts
        self._things: dict[str, list[tuple[Vector, Vector]]] = {}
        self._rays: dict[str, tuple[Vector, float, LaserScan]] = {}

    def take(self, port: str, scan: LaserScan, base: BaseState) -> None:
        """Take a scan, and where the base was [m, rad]."""
        x, y, yaw = self._mounts[port]
        cos, sin = math.cos(base.yaw), math.sin(base.yaw)
        at = np.array([base.x + cos * x - sin * y, base.y + sin * x + cos * y])
        ranges = np.array(scan.ranges)
        first = base.yaw + yaw + scan.angle_min
        self._rays[port] = at, first, scan
        angles = first + scan.angle_increment * np.arange(len(ranges))
        away = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._things[port] = list(_things(at, ranges, away))

    def snapshot(self) -> "LidarView":
        """Return the same view, which later scans do not change."""
        view = LidarView(self._mounts)
        view._things = dict(self._things)
        return view

    def sees_through(self, place: Vector) -> bool:
        """Return whether some ray goes on beyond a place, shape (2,) [m]."""
        for at, first, scan in self._rays.values():
            dx, dy = (place - at).tolist()
            turn = (math.atan2(dy, dx) - first) % math.tau
            number = round(turn / scan.angle_increment)
            if number < len(scan.ranges) and scan.ranges[number] > math.hypot(dx, dy) + _BEYOND:
                return True
        return False

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
                    sides = np.stack([face.min(axis=0), face.max(axis=0)])
                    behind = face + min(_DEPTH, math.dist(*sides)) * away[is_new]
                    corners = hull(np.concatenate([face, behind]))
                    seen.append(Outline(link=SEEN, corners=corners, face=sides))
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
    it was planned.
    """

    def __init__(
        self, request_id: int, route: Sequence[Point], known: Sequence[Outline], params: Params
    ) -> None:
        self.request_id = request_id
        self._known, self._params = known, params
        self._places = places_along(route)
        self._next = self._gone = 0

    def check(self, seen: Walkers, base: BaseState) -> str:
        """Return a sentence about what is in the way of the rest of the route; empty: nothing.

        For whoever walks the base stops only where that is safer than to go on.
        """
        here = np.array([base.x, base.y])
        away = np.linalg.norm(self._places[self._next :, :2] - here, axis=1)
        # The base goes on along the route, and does not jump to where it crosses itself.
        self._next += int(away[: round(1.0 / STRIDE)].argmin())
        ahead = self._places[self._next :]
        if seen.walking:
            way = np.concatenate([[(*here, 0.0)], ahead[1:]])
            radius = self._params.base_radius
            safety = seen.safety(going(way, abs(base.vx), self._params), radius)
            if safety < 0.0 and seen.safety(braking(base), radius) > safety:
                return f"{SEEN} walks towards its way"
        for thing in [*seen.standing, *seen.pausing]:
            is_known = any(
                (distances(thing.corners, row.corners) < _SAME).any() for row in self._known
            )
            room = self._params.base_half_width + (-_TOLERANCE if is_known else _LATER)
            gaps = distances(ahead[:, :2], thing.corners)
            # To what is beside it, and no nearer ahead, it comes no closer.
            hits = np.flatnonzero(gaps < room)
            if len(hits) and gaps[hits].min() < gaps[0] - 1e-2:
                far = float(np.linalg.norm(ahead[gaps.argmin(), :2] - here))
                return f"{thing.link} is {gaps.min():.2f} m from the route, {far:.1f} m ahead"
        return ""

    def is_needless(self, view: LidarView) -> bool:
        """Return whether the route is a detour around something that has gone."""
        ahead = self._places[self._next :, :2]
        straight = float(np.linalg.norm(ahead[-1] - ahead[0]))
        is_detour = STRIDE * (len(ahead) - 1) > straight + _DETOUR
        gone = any(view.sees_through(row.corners.mean(axis=0)) for row in self._known)
        self._gone = self._gone + 1 if is_detour and gone else 0
        return self._gone >= _SURE
