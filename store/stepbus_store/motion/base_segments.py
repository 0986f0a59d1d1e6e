"""Segments of a base's path: lines, turns on the spot and arcs, each planned where it starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import BaseState, Point
from stepbus_store.pace import Agility
from stepbus_store.poses import wrapped

LEAST_ARC = 1e-3
"""Distance of two poses below which the base turns on the spot [m]."""

_NO_LENGTH = 1e-9
"""Length of a segment that is none [m, rad]."""

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
class Turn:
    """A turn on the spot from a pose; length: [rad], below 0: clockwise."""

    x: float
    y: float
    yaw: float
    length: float

    turns = True

    def at(self, s: float, speed: float) -> Reference:
        """Return the reference after s of the length, at a speed along it."""
        return Reference(x=self.x, y=self.y, yaw=self.yaw + s, vx=0.0, wz=speed)

    def shown(self, s: float) -> str:
        """Return a length with its unit."""
        return f"{math.degrees(s):.1f}°"

    def curvature(self, s: float) -> float:
        """Return 0: it has no path."""
        return 0.0


class Curve:
    """Arcs, or a straight line, that follow one another without a corner.

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
        # From the middle of an arc to that of the next one the curvature changes evenly.
        middles, ends, bends = (self._ends[:-1] + self._ends[1:]) / 2, self._ends, self._curvature
        self._places = np.concatenate([ends[:1], middles, ends[-1:]])
        self._bends = np.concatenate([bends[:1], bends, bends[-1:]])
        self._speeds: Vector | None = None
        self.length = float(self._s[-1])

    def limits(self, s: float, lead: float, agility: Agility) -> tuple[float, float]:
        """Return the largest speed and acceleration at s [m/s, m/s²], of one agility.

        lead: how far the base drives until it slows down [m].
        """
        if self._speeds is None:
            self._speeds = agility.speeds(self._places, self._bends)
            self._pushes = agility.pushes(self._bends)
        at = abs(s)
        speed = float(np.interp([at, at + lead], self._places, self._speeds).min())
        stop = speed**2 / (2.0 * agility.push) + lead
        # It comes to rest with an acceleration that the whole rest of the curve allows.
        until = at + (lead if at + stop < self._ends[-1] else stop)
        near = self._pushes[slice(*np.searchsorted(self._places, [at, until]))]
        here = float(np.interp(at, self._places, self._pushes))
        return speed, min(here, float(near.min(initial=here)))

    def curvature(self, s: float) -> float:
        """Return the change of the heading with the length at s [1/m], without steps."""
        return float(np.interp(abs(s), self._places, self._bends))

    def at(self, s: float, speed: float) -> Reference:
        """Return the reference after s of the length, at a speed along it."""
        after = int(np.searchsorted(self._ends, abs(s), side="right"))
        n = min(after - 1, len(self._curvature) - 1)
        x, y, yaw = map(float, self._poses[n])
        along, curvature = s - float(self._s[n]), float(self._curvature[n])
        turn = curvature * along
        chord = along * float(np.sinc(turn / (2 * np.pi)))
        x, y = x + chord * math.cos(yaw + turn / 2), y + chord * math.sin(yaw + turn / 2)
        return Reference(x=x, y=y, yaw=yaw + turn, vx=speed, wz=speed * self.curvature(s))

    def shown(self, s: float) -> str:
        """Return a length with its unit."""
        return f"{s:.3f} m"


Segment = Turn | Curve
"""What a base drives without stopping."""

PlannedSegment = Callable[[BaseState], Segment | None]
"""Makes a segment from the base's pose at its start; None: it has no length."""


def straight(length: float) -> PlannedSegment:
    """Return a line along the heading that the base then has [m]."""
    return partial(_ahead, length=length)


def _ahead(now: BaseState, length: float) -> Segment | None:
    x, y = now.x + length * math.cos(now.yaw), now.y + length * math.sin(now.yaw)
    return _line(now, now.yaw, x, y, back=length < 0.0)


def straight_to(x: float, y: float, *, back: bool) -> PlannedSegment:
    """Return the straight line to a point [m], forwards or backwards."""
    return partial(_to, x=x, y=y, back=back)


def _to(now: BaseState, x: float, y: float, *, back: bool) -> Segment | None:
    heading = math.atan2(y - now.y, x - now.x) + (math.pi if back else 0.0)
    return _line(now, now.yaw + wrapped(heading - now.yaw), x, y, back=back)


def _line(now: BaseState, yaw: float, x: float, y: float, *, back: bool) -> Segment | None:
    if math.hypot(x - now.x, y - now.y) < _NO_LENGTH:
        return None
    return Curve(np.array([(now.x, now.y, yaw), (x, y, yaw)]), back=back)


def turn_by(angle: float) -> PlannedSegment:
    """Return a turn by an angle [rad]."""
    return partial(_turn, angle=angle)


def turn_to(yaw: float) -> PlannedSegment:
    """Return the shorter turn to a heading [rad]."""
    return partial(_turn_to, yaw=yaw)


def _turn_to(now: BaseState, yaw: float) -> Segment | None:
    return _turn(now, wrapped(yaw - now.yaw))


def _turn(now: BaseState, angle: float) -> Segment | None:
    return None if abs(angle) < _NO_LENGTH else Turn(x=now.x, y=now.y, yaw=now.yaw, length=angle)


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
    return partial(_through, poses=poses, back=back)


def _through(now: BaseState, poses: Sequence[Point], *, back: bool) -> Curve:
    yaws = [now.yaw + wrapped(poses[0][2] - now.yaw)]
    for before, after in pairwise(poses):
        yaws.append(yaws[-1] + wrapped(after[2] - before[2]))
    rows = [(x, y, yaw) for (x, y, _), yaw in zip(poses, yaws, strict=True)]
    return Curve(np.array(rows), back=back)
