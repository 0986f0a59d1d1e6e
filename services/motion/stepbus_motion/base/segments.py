"""The ways of a mobile base: straight, or a turn on the spot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from stepbus_schemas import BaseState


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Where the base shall be, and its velocities there, in the frame of odometry."""

    x: float
    y: float
    yaw: float
    vx: float
    wz: float


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A straight way or a turn on the spot, from a pose on.

    length: [m], or [rad] where it turns; below 0: back, or clockwise.
    """

    x: float
    y: float
    yaw: float
    length: float
    turns: bool

    def at(self, s: float, speed: float) -> Reference:
        """Return the reference after a way s of the length, at a speed along it."""
        if self.turns:
            return Reference(x=self.x, y=self.y, yaw=self.yaw + s, vx=0.0, wz=speed)
        x, y = self.x + s * math.cos(self.yaw), self.y + s * math.sin(self.yaw)
        return Reference(x=x, y=y, yaw=self.yaw, vx=speed, wz=0.0)

    def shown(self, s: float) -> str:
        """Return a way along the leg in words."""
        return f"{math.degrees(s):.1f}°" if self.turns else f"{s:.3f} m"


PlannedLeg = Callable[[BaseState], Leg | None]
"""Makes a leg from where the base is when its turn comes; None: it is not needed."""


def wrapped(angle: float) -> float:
    """Return the same angle between -π and π [rad]."""
    return math.remainder(angle, 2 * math.pi)


def turning(state: BaseState, last: float, heading: float) -> float:
    """Return how much a base turns in all that drives at a heading and looks to `last` [rad]."""
    return abs(wrapped(heading - state.yaw)) + abs(wrapped(last - heading))


def straight(length: float) -> PlannedLeg:
    """Return a way ahead along the heading that the base then has [m]."""
    return lambda now: _leg(now, length, turns=False)


def straight_to(x: float, y: float, *, back: bool) -> PlannedLeg:
    """Return the straight way to a point [m], ahead or back."""

    def plan(now: BaseState) -> Leg | None:
        heading = math.atan2(y - now.y, x - now.x) + (math.pi if back else 0.0)
        yaw = now.yaw + wrapped(heading - now.yaw)
        way = math.hypot(x - now.x, y - now.y)
        return Leg(x=now.x, y=now.y, yaw=yaw, length=-way if back else way, turns=False)

    return plan


def turn_by(angle: float) -> PlannedLeg:
    """Return a turn by an angle [rad]."""
    return lambda now: _leg(now, angle, turns=True)


def turn_to(yaw: float) -> PlannedLeg:
    """Return the shorter turn to a heading [rad]."""
    return lambda now: _leg(now, wrapped(yaw - now.yaw), turns=True)


def same_line(leg: Leg, length: float) -> PlannedLeg:
    """Return a way along the line of another leg, from wherever the base then is."""
    if leg.turns:
        return turn_by(length)

    def plan(now: BaseState) -> Leg | None:
        along = (now.x - leg.x) * math.cos(leg.yaw) + (now.y - leg.y) * math.sin(leg.yaw)
        x, y = leg.x + along * math.cos(leg.yaw), leg.y + along * math.sin(leg.yaw)
        return Leg(x=x, y=y, yaw=leg.yaw, length=length, turns=False)

    return plan


def _leg(now: BaseState, length: float, *, turns: bool) -> Leg | None:
    if abs(length) < 1e-9:
        return None
    return Leg(x=now.x, y=now.y, yaw=now.yaw, length=length, turns=turns)
