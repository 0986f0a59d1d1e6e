"""From a goal of the base to the segments of its path."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from stepbus_schemas import BaseState, Goal, Point
from stepbus_store.cause import Cause
from stepbus_store.motion.base_segments import (
    LEAST_ARC,
    PlannedSegment,
    arc_direction,
    curve,
    straight,
    straight_to,
    turn_by,
    turn_to,
)
from stepbus_store.motion.outcome import FARTHEST, Refused
from stepbus_store.poses import wrapped


@dataclass(frozen=True, kw_only=True)
class BaseRoute:
    """The segments of a goal; target: pose to stand at [m, rad]; None: wherever the last ends."""

    segments: deque[PlannedSegment]
    text: str
    target: tuple[float, float, float] | None = None


def base_route(
    goal: Goal, state: BaseState, position: float, route: Sequence[Point] = ()
) -> BaseRoute:
    """Return the segments that a goal needs from the base's state.

    route: poses that lead to that of a go_to, and that one, each x, y, yaw [m, rad]. Without
    it, closer to its target than twice `position` [m], the base only turns. Raises Refused for a
    goal that makes no sense.
    """
    if goal.type in {"drive", "turn"}:
        _refuse_odd("by", goal.by)
        if goal.type == "drive":
            return BaseRoute(segments=deque([straight(goal.by)]), text=f"drive {goal.by:.3f} m")
        text = f"turn by {math.degrees(goal.by):.1f}°"
        return BaseRoute(segments=deque([turn_by(goal.by)]), text=text)
    if goal.type not in {"go_to", "go_together"} or goal.base is None:
        raise Refused(Cause.INVALID, f"type {goal.type} needs base: x, y, yaw")
    for name, value in zip(("x", "y", "yaw"), goal.base, strict=True):
        _refuse_odd(name, value)
    x, y, yaw = goal.base
    places = [(state.x, state.y), *(route or [goal.base])]
    length = sum(math.dist(a[:2], b[:2]) for a, b in pairwise(places))
    text = f"go {length:.3f} m to x {x:.3f} m, y {y:.3f} m, yaw {math.degrees(yaw):.1f}°"
    segments: deque[PlannedSegment] = deque()
    if route:
        _add_route(segments, route, (state.x, state.y, state.yaw))
    elif length > 2 * position:
        _line(segments, (state.x, state.y, state.yaw), goal.base, None)
    segments.append(turn_to(yaw))
    return BaseRoute(segments=segments, text=text, target=goal.base)


def first_part(start: Point, route: Sequence[Point], length: float) -> list[Point] | None:
    """Return the first part of a route from a pose; None: it is no longer than that [m]."""
    left, now, part = length, start, list[Point]()
    for pose in route:
        far = math.dist(now[:2], pose[:2])
        if far > left + LEAST_ARC:
            part.append(_between(now, pose, left / far))
            return part
        part.append(pose)
        left, now = left - far, pose
    return None


def _between(a: Point, b: Point, share: float) -> Point:
    """Return a pose between two others: on an arc, or on a straight line."""
    x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
    if arc_direction(a, b):
        return (x, y, a[2] + share * wrapped(b[2] - a[2]))
    return (x, y, math.atan2(b[1] - a[1], b[0] - a[0]))


def _add_route(segments: deque[PlannedSegment], route: Sequence[Point], now: Point) -> None:
    """Add the segments along a planned route: arcs where they fit, else lines and turns."""
    direction, driven = 0, 0
    arcs: list[Point] = []
    for n, pose in enumerate(route):
        end, direction = pose, arc_direction(now, pose)
        if arcs and direction != driven:
            segments.append(curve(arcs, back=driven < 0))
            arcs = []
        if direction:
            arcs, driven = [*(arcs or [now]), pose], direction
        elif math.dist(now[:2], pose[:2]) < LEAST_ARC:
            segments.append(turn_to(pose[2]))
        else:
            end = _line(segments, now, pose, route[n + 1] if n + 1 < len(route) else None)
        now = end
    if arcs:
        segments.append(curve(arcs, back=driven < 0))


def _line(segments: deque[PlannedSegment], now: Point, pose: Point, after: Point | None) -> Point:
    """Add a turn and a straight line, forwards or backwards; return the pose at its end."""
    x, y, yaw = pose
    ahead = math.atan2(y - now[1], x - now[0])
    following = [yaw]
    if after is not None:
        heading = math.atan2(after[1] - y, after[0] - x)
        following = [heading, heading + math.pi]
    forwards, backwards = (
        min(_turning(now[2], last, ahead + flip) for last in following) for flip in (0, math.pi)
    )
    back = backwards < forwards - 1e-9
    heading = ahead + math.pi if back else ahead
    segments += [turn_to(heading), straight_to(x, y, back=back)]
    return (x, y, heading)


def _turning(yaw: float, last: float, heading: float) -> float:
    """Return how much the base turns in all to drive at a heading and end at `last` [rad]."""
    return abs(wrapped(heading - yaw)) + abs(wrapped(last - heading))


def _refuse_odd(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise Refused(Cause.INVALID, f"{name} is {value}, not a finite number")
    if abs(value) > FARTHEST:
        text = f"{name} is {value:g}; more than {FARTHEST:g} m or rad is too far"
        raise Refused(Cause.INVALID, text)
