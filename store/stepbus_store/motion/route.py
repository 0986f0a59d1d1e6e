"""From a goal of the base to segments."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import BaseState, Goal, Point
from stepbus_store.cause import Cause
from stepbus_store.motion.outcome import FARTHEST, Refused


@dataclass(frozen=True, kw_only=True)
class BaseRoute:
    """The segments of a goal.

    target: pose to stand at, x, y, yaw [m, rad]; None: wherever the last segment ends.
    """

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
    if goal.type == "drive":
        _refuse_odd("by", goal.by)
        return BaseRoute(segments=deque([straight(goal.by)]), text=f"drive {goal.by:.3f} m")
    if goal.type == "turn":
        _refuse_odd("by", goal.by)
        text = f"turn by {math.degrees(goal.by):.1f}°"
        return BaseRoute(segments=deque([turn_by(goal.by)]), text=text)
    if goal.type not in {"go_to", "go_together"} or goal.base is None:
        raise Refused(Cause.INVALID, f"type {goal.type} needs base: x, y, yaw")
    for name, value in zip(("x", "y", "yaw"), goal.base, strict=True):
        _refuse_odd(name, value)
    return _route_by(route, goal.base, state) if route else _route_to(goal.base, state, position)


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


def _route_by(route: Sequence[Point], target: Point, state: BaseState) -> BaseRoute:
    """Return the segments along a planned route: arcs where they fit, else lines and turns."""
    segments: deque[PlannedSegment] = deque()
    now, direction, driven = (state.x, state.y, state.yaw), 0, 0
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
    segments.append(turn_to(target[2]))
    x, y, yaw = target
    length = sum(math.dist(a[:2], b[:2]) for a, b in pairwise([(state.x, state.y), *route]))
    text = f"go {length:.3f} m to x {x:.3f} m, y {y:.3f} m, yaw {math.degrees(yaw):.1f}°"
    return BaseRoute(segments=segments, text=text, target=target)


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


def _route_to(target: tuple[float, float, float], state: BaseState, position: float) -> BaseRoute:
    x, y, yaw = target
    length = math.hypot(x - state.x, y - state.y)
    text = f"go {length:.3f} m to x {x:.3f} m, y {y:.3f} m, yaw {math.degrees(yaw):.1f}°"
    last = turn_to(yaw)
    if length <= 2 * position:
        return BaseRoute(segments=deque([last]), text=text, target=target)
    ahead = math.atan2(y - state.y, x - state.x)
    back = _turning(state.yaw, yaw, ahead + math.pi) < _turning(state.yaw, yaw, ahead) - 1e-9
    first = turn_to(ahead + math.pi if back else ahead)
    segments = deque([first, straight_to(x, y, back=back), last])
    return BaseRoute(segments=segments, text=text, target=target)


def _turning(yaw: float, last: float, heading: float) -> float:
    """Return how much the base turns in all to drive at a heading and end at `last` [rad]."""
    return abs(wrapped(heading - yaw)) + abs(wrapped(last - heading))


def _refuse_odd(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise Refused(Cause.INVALID, f"{name} is {value}, not a finite number")
    if abs(value) > FARTHEST:
        raise Refused(
            Cause.INVALID, f"{name} is {value:g}; more than {FARTHEST:g} m or rad is too far"
        )


LEAST_ARC = 1e-3
"""Distance of two poses below which the base turns on the spot [m]."""

_BESIDE = 3e-3
"""How far beside an arc its end may be [m]."""


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Pose and velocities that the base follows, in the frame of odometry [m, rad, m/s, rad/s]."""

    x: float
    y: float
    yaw: float
    vx: float
    wz: float

    @classmethod
    def standing(cls, x: float, y: float, yaw: float) -> Reference:
        """Return a reference at rest."""
        return cls(x=x, y=y, yaw=yaw, vx=0.0, wz=0.0)


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A straight line or a turn on the spot, from a pose.

    length: [m], or [rad] where it turns; below 0: backwards, or clockwise.
    """

    x: float
    y: float
    yaw: float
    length: float
    turns: bool

    def at(self, s: float, speed: float) -> Reference:
        """Return the reference after s of the length, at a speed along it."""
        if self.turns:
            return Reference(x=self.x, y=self.y, yaw=self.yaw + s, vx=0.0, wz=speed)
        x, y = self.x + s * math.cos(self.yaw), self.y + s * math.sin(self.yaw)
        return Reference(x=x, y=y, yaw=self.yaw, vx=speed, wz=0.0)

    def shown(self, s: float) -> str:
        """Return a length with its unit."""
        return f"{math.degrees(s):.1f}°" if self.turns else f"{s:.3f} m"

    def curvature(self, s: float) -> float:
        """Return the change of the heading with the length at s [1/m]."""
        return 0.0

    @property
    def sharpest(self) -> float:
        """Return the largest curvature [1/m]."""
        return 0.0


class Curve:
    """Arcs that follow one another without a corner.

    poses: x, y, yaw at the ends of the arcs, shape (k, 3) [m, rad]; yaw goes on without jumps by a
    full turn. back: the base drives backwards; then lengths are below 0.
    """

    turns = False

    def __init__(self, poses: Vector, *, back: bool) -> None:
        self._poses = poses
        step, turn = np.diff(poses[:, :2], axis=0), np.diff(poses[:, 2])
        chords = np.hypot(step[:, 0], step[:, 1])
        # An arc is longer than its chord.
        arcs = chords / np.sinc(turn / (2 * np.pi)) * (-1.0 if back else 1.0)
        self._s = np.concatenate([[0.0], np.cumsum(arcs)])
        self._curvature = turn / arcs
        self._ends = np.abs(self._s)
        self.length = float(self._s[-1])

    @property
    def sharpest(self) -> float:
        """Return the largest curvature [1/m]."""
        return float(np.abs(self._curvature).max())

    def curvature(self, s: float) -> float:
        """Return the change of the heading with the length at s [1/m]."""
        return float(self._curvature[self._arc(s)])

    def at(self, s: float, speed: float) -> Reference:
        """Return the reference after s of the length, at a speed along it."""
        n = self._arc(s)
        x, y, yaw = map(float, self._poses[n])
        along, curvature = s - float(self._s[n]), float(self._curvature[n])
        turn = curvature * along
        chord = along * float(np.sinc(turn / (2 * np.pi)))
        x, y = x + chord * math.cos(yaw + turn / 2), y + chord * math.sin(yaw + turn / 2)
        return Reference(x=x, y=y, yaw=yaw + turn, vx=speed, wz=speed * curvature)

    def shown(self, s: float) -> str:
        """Return a length with its unit."""
        return f"{s:.3f} m"

    def _arc(self, s: float) -> int:
        index = int(np.searchsorted(self._ends, abs(s), side="right")) - 1
        return min(index, len(self._curvature) - 1)


PlannedSegment = Callable[[BaseState], Segment | Curve | None]
"""Makes a segment from the base's pose at its start; None: it has no length."""


def wrapped(angle: float) -> float:
    """Return the same angle between -π and π [rad]."""
    return math.remainder(angle, 2 * math.pi)


def straight(length: float) -> PlannedSegment:
    """Return a line along the heading that the base then has [m]."""
    return lambda now: _segment(now, length, turns=False)


def straight_to(x: float, y: float, *, back: bool) -> PlannedSegment:
    """Return the straight line to a point [m], forwards or backwards."""

    def plan(now: BaseState) -> Segment | None:
        heading = math.atan2(y - now.y, x - now.x) + (math.pi if back else 0.0)
        yaw = now.yaw + wrapped(heading - now.yaw)
        length = math.hypot(x - now.x, y - now.y)
        return Segment(x=now.x, y=now.y, yaw=yaw, length=-length if back else length, turns=False)

    return plan


def turn_by(angle: float) -> PlannedSegment:
    """Return a turn by an angle [rad]."""
    return lambda now: _segment(now, angle, turns=True)


def turn_to(yaw: float) -> PlannedSegment:
    """Return the shorter turn to a heading [rad]."""
    return lambda now: _segment(now, wrapped(yaw - now.yaw), turns=True)


def arc_direction(a: Point, b: Point) -> int:
    """Return whether an arc leads from one pose to another: 1, backwards: -1, none does: 0."""
    length = math.dist(a[:2], b[:2])
    if length < LEAST_ARC:
        return 0
    chord = math.atan2(b[1] - a[1], b[0] - a[0])
    middle = a[2] + wrapped(b[2] - a[2]) / 2
    for direction, heading in ((1, middle), (-1, middle + math.pi)):
        if length * abs(wrapped(chord - heading)) < _BESIDE:
            return direction
    return 0


def curve(poses: Sequence[Point], *, back: bool) -> PlannedSegment:
    """Return the arcs through poses, from the first one on, wherever the base then is near it."""

    def plan(now: BaseState) -> Curve:
        yaws = [now.yaw + wrapped(poses[0][2] - now.yaw)]
        for before, after in pairwise(poses):
            yaws.append(yaws[-1] + wrapped(after[2] - before[2]))
        rows = [(x, y, yaw) for (x, y, _), yaw in zip(poses, yaws, strict=True)]
        return Curve(np.array(rows), back=back)

    return plan


def same_line(segment: Segment | Curve, length: float) -> PlannedSegment:
    """Return a segment along the line of another one, from wherever the base then is."""
    if isinstance(segment, Curve):
        return straight(length)
    if segment.turns:
        return turn_by(length)
    x0, y0, yaw = segment.x, segment.y, segment.yaw

    def plan(now: BaseState) -> Segment | None:
        along = (now.x - x0) * math.cos(yaw) + (now.y - y0) * math.sin(yaw)
        x, y = x0 + along * math.cos(yaw), y0 + along * math.sin(yaw)
        return Segment(x=x, y=y, yaw=yaw, length=length, turns=False)

    return plan


def _segment(now: BaseState, length: float, *, turns: bool) -> Segment | None:
    if abs(length) < 1e-9:
        return None
    return Segment(x=now.x, y=now.y, yaw=now.yaw, length=length, turns=turns)
