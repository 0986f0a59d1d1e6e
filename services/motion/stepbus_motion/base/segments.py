"""The segments of a base's path: straight, or a turn on the spot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from stepbus_schemas import BaseState


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


PlannedSegment = Callable[[BaseState], Segment | None]
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


def same_line(segment: Segment, length: float) -> PlannedSegment:
    """Return a segment along the line of another one, from wherever the base then is."""
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
