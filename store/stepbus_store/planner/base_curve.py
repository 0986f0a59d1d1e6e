"""Smooth routes of a base: curves that leave and reach a heading, as circular arcs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import Point
from stepbus_store.pace import Agility
from stepbus_store.planner.params import Params
from stepbus_store.poses import wrapped

_ARC = 0.05
"""Length of the arcs that a curve is made of [m]."""

_HANDLES = (0.35, 0.45, 0.55)
"""Lengths of a curve's tangents, as shares of the distance of its ends."""

_TURNS = (0.0, 0.5, 1.0)
"""Shares of the turn towards the goal that the base may make on the spot before it drives."""

_WIDTHS = (0.9, 0.6, 0.4, 0.2)
"""Lengths along corners that are averaged, the largest first [m]."""

_FINE = 0.01
"""Distance of the points that are averaged [m]."""

_SHARPEST = 3.0
"""Largest curvature of a curve [1/m]."""

_SHARPEST_CORNER = 6.0
"""The same along corners [1/m]."""

_STOP = 0.3
"""What each stop costs besides [s]."""


@dataclass(frozen=True, kw_only=True)
class SmoothRoute:
    """Poses along a route, each x, y, yaw [m, rad]; the first one is the start.

    Between two poses the base turns on the spot, where they have the same position, or drives an
    arc. seconds: estimated. sharpest: largest curvature [1/m].
    """

    poses: tuple[Point, ...]
    seconds: float
    sharpest: float = 0.0

    @property
    def length(self) -> float:
        """Return the length of the route [m]."""
        return sum(math.dist(a[:2], b[:2]) for a, b in pairwise(self.poses))


def direct_routes(start: Point, goal: Point, params: Params) -> list[SmoothRoute]:
    """Return curves from a pose to another one, forwards and backwards, the quickest first."""
    a, b = np.array(start[:2]), np.array(goal[:2])
    chord = math.atan2(*(b - a)[::-1])
    routes = []
    for back, share, ends_at_goal in product((False, True), _TURNS, (True, False)):
        flip = math.pi if back else 0.0
        first = start[2] + share * wrapped(chord + flip - start[2])
        last = goal[2] if ends_at_goal else chord + flip
        for handle in _HANDLES:
            points = _bezier(a, first - flip, b, last - flip, handle)
            routes.append(_route((start, goal), points, (first, last), params, back=back))
    smooth = [route for route in routes if route.sharpest <= _SHARPEST]
    return sorted(smooth, key=lambda route: route.seconds)


def rounded_routes(
    start: Point, goal: Point, corners: Sequence[Vector], params: Params
) -> Iterator[SmoothRoute]:
    """Yield routes along corners that are smoothed, forwards and backwards.

    corners: from start to goal, each of shape (2,) [m].
    """
    for width in _WIDTHS if corners else ():
        points = _smoothed(corners, width)
        for back in (False, True):
            flip = math.pi if back else 0.0
            first, last = _heading(points[:3]) + flip, _heading(points[:-4:-1]) + flip + math.pi
            route = _route((start, goal), points, (first, last), params, back=back)
            if route.sharpest <= _SHARPEST_CORNER:
                yield route


def _heading(points: Vector) -> float:
    """Return the direction at the first of three points, as that of an arc through them."""
    a, b = (math.atan2(*(q - p)[::-1]) for p, q in pairwise(points))
    return a - wrapped(b - a) / 2


def _route(
    ends: tuple[Point, Point],
    points: Vector,
    headings: tuple[float, float],
    params: Params,
    *,
    back: bool,
) -> SmoothRoute:
    """Return the route along points, with turns on the spot at both ends where they are needed.

    headings: of the base at the first and the last point [rad].
    """
    (start, goal), (first, last) = ends, headings
    yaws = _yaws(points, first, last, back=back)
    poses: list[Point] = [start]
    if abs(wrapped(first - start[2])) > 1e-9:
        poses.append((start[0], start[1], first))
    rows = zip(points[1:].tolist(), yaws[1:], strict=True)
    poses += [(x, y, wrapped(yaw)) for (x, y), yaw in rows]
    if abs(wrapped(goal[2] - yaws[-1])) > 1e-9:
        poses.append(goal)
    else:
        poses[-1] = goal
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    far, bends = np.insert(np.cumsum(steps), 0, 0.0), np.diff(yaws) / steps
    # The curvature is that of an arc in its middle.
    along = np.concatenate([far[:1], (far[1:] + far[:-1]) / 2, far[-1:]])
    curvature = np.concatenate([bends[:1], bends, bends[-1:]])
    seconds = _STOP + _agility(params).seconds(along, curvature)
    for angle in (first - start[2], goal[2] - yaws[-1]):
        seconds += _turn_time(params, wrapped(angle))
    sharpest = float(np.abs(bends).max())
    return SmoothRoute(poses=tuple(poses), seconds=seconds, sharpest=sharpest)


def _agility(params: Params) -> Agility:
    return Agility(
        speed=params.base_speed,
        turning=params.base_turn_speed,
        push=params.base_acceleration,
        swing=params.base_turn_acceleration,
        twist=params.base_turn_jerk,
    )


def _yaws(points: Vector, first: float, last: float, *, back: bool) -> list[float]:
    """Return the headings at points on a curve, without jumps by a full turn.

    An arc through two poses has its chord half-way between both headings.
    """
    chords = np.arctan2(np.diff(points[:, 1]), np.diff(points[:, 0])) + (math.pi if back else 0.0)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turns = [wrapped(b - a) for a, b in pairwise(chords)]
    yaws = [first]
    at = first + wrapped(float(chords[0]) - first)
    for turn, before, after in zip(turns, lengths[:-1], lengths[1:], strict=True):
        # The heading between two chords, nearer to that of the shorter one.
        yaws.append(at + turn * float(before / (before + after)))
        at += turn
    return [*yaws, yaws[-1] + wrapped(last - yaws[-1])]


def _bezier(a: Vector, first: float, b: Vector, last: float, handle: float) -> Vector:
    """Return points _ARC apart on a curve with given directions at its ends [rad]."""
    far = handle * float(np.linalg.norm(b - a))
    out = far * np.array([math.cos(first), math.sin(first)])
    into = far * np.array([math.cos(last), math.sin(last)])
    return _apart(_quintic(np.linspace(0.0, 1.0, 201)[:, None], a, out, b, into))


def _quintic(t: Vector, a: Vector, out: Vector, b: Vector, into: Vector) -> Vector:
    """Return points of a Bézier curve of degree 5 that is straight at both ends.

    t: shape (k, 1), from 0 to 1. out, into: its tangents there [m].
    """
    controls = (a, a + out / 2, a + out, b - into, b - into / 2, b)
    return np.asarray(
        sum(math.comb(5, n) * (1 - t) ** (5 - n) * t**n * row for n, row in enumerate(controls))
    )


def _smoothed(corners: Sequence[Vector], width: float) -> Vector:
    """Return points along corners, each the mean of what is that near along the way [m]."""
    count = round(width / _FINE * 2 / 3)
    first, last = ((b - a) / np.linalg.norm(b - a) * width for a, b in (corners[:2], corners[-2:]))
    ends = np.array([corners[0] - first, *corners, corners[-1] + last])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ends, axis=0), axis=1))])
    s = np.arange(0.0, along[-1] + _FINE / 2, _FINE)
    dense = np.stack([np.interp(s, along, ends[:, n]) for n in (0, 1)], axis=1)
    once = np.ones(count) / count
    kernel = np.convolve(np.convolve(once, once), once)
    rows = np.stack([np.convolve(dense[:, n], kernel, "valid") for n in (0, 1)], axis=1)
    # A corner near an end moves that; it goes back smoothly, over twice that width.
    for way, end in ((rows, corners[0]), (rows[::-1], corners[-1])):
        near = np.maximum(1.0 - np.arange(len(rows)) * _FINE / (2.0 * width), 0.0)
        way[:] += (near**3 * (10.0 - 15.0 * near + 6.0 * near**2))[:, None] * (end - way[0])
    return _apart(rows)


def _apart(dense: Vector) -> Vector:
    """Return points along others, about _ARC apart; the ends are the same."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    s = np.linspace(0.0, along[-1], max(math.ceil(along[-1] / _ARC), 2) + 1)
    points: Vector = np.stack([np.interp(s, along, dense[:, n]) for n in (0, 1)], axis=1)
    points[[0, -1]] = dense[[0, -1]]
    return points


def _turn_time(params: Params, angle: float) -> float:
    """Return how long a turn on the spot takes [s]."""
    speed, swing, turn = params.base_turn_speed, params.base_turn_acceleration, abs(angle)
    if turn < 1e-9:
        return 0.0
    rise = min(speed / swing, math.sqrt(turn / swing))
    return _STOP + turn / (swing * rise) + rise
