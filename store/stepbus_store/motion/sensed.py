"""Sensed contacts and gaps, and the obstacles that stopped the arm."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import Vector

MORE_FORCE = 5.0
"""On top of the force at the start of a goal, a touch is a collision; of a pad that does not grip,
also on what it may touch [N]."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two links; ours: the robot's, or what it holds."""

    ours: str
    other: str

    @property
    def pair(self) -> tuple[str, str]:
        """Return the names of both links."""
        return self.ours, self.other


@dataclass(frozen=True, kw_only=True)
class Collision(Pair):
    """A forbidden touch; force: [N]."""

    force: float

    def __str__(self) -> str:
        return f"{self.ours} touches {self.other} with {self.force:.1f} N"


@dataclass(frozen=True, kw_only=True)
class Approach(Pair):
    """Two links that are close; gap: [m]."""

    gap: float

    def __str__(self) -> str:
        return f"{self.ours} is {self.gap * 1e3:.1f} mm from {self.other}"


@dataclass(frozen=True, kw_only=True)
class Watch:
    """The contacts and gaps of a step.

    collision: the hardest forbidden touch. near: the closest pair that must not touch, and `gap`
    its distance [m]; None: nothing is near. scale: share of the full speed, 0 to 1. room: for the
    base, the distance to the closest thing, longer for what it passes by; what contacts do not
    report may be just beyond their range [m]. unexpected: the pairs of which one is no link of the
    robot, and what the hardest stop would leave of each gap, below 0: it is too weak [m]; the least
    one first.
    """

    collision: Collision | None = None
    near: tuple[str, str] | None = None
    gap: float = math.inf
    scale: float = 1.0
    room: float = math.inf
    unexpected: Sequence[tuple[Approach, float]] = ()


_SAME_PLACE = 0.02
"""Nearer than this to where a link was stopped, it is stopped for the same thing again, if it is
as near to that; faster links are stopped farther from it [m]."""

_NOISE = (2e-4, 0.1)
"""A gap that is smaller by that [m], or by that share of it, has become smaller."""

_ON_LINE = 1e-3
"""A line, which may lead close past things, ends before it is nearer than this [m]."""


class SensedThings:
    """The gaps when the arm began to move, and the things that have stopped it.

    Whether its planner knows these things, the arm cannot tell. They are remembered as long as
    they are sensed. stop_within: on a planner's path the arm stops before something is closer [m].
    """

    def __init__(self, stop_within: float) -> None:
        self._stop_within = stop_within
        self._at_rest: dict[tuple[str, str], float] = {}
        self._places: dict[str, dict[str, tuple[Vector, float]]] = {}

    @property
    def known(self) -> frozenset[str]:
        """Return the things that have stopped the arm."""
        return frozenset(self._places)

    def update(self, watch: Watch, *, is_moving: bool) -> None:
        """Update with the pairs of a step; is_moving: the arm moves."""
        others = {near.other for near, _ in watch.unexpected}
        self._places = {other: at for other, at in self._places.items() if other in others}
        if not is_moving:
            self._at_rest = {near.pair: near.gap for near, _ in watch.unexpected}

    def hindrance(self, watch: Watch, *, on_plan: bool) -> Approach | None:
        """Return the obstacle to stop for; None: none. on_plan: the arm is on a planner's path.

        What is close from the start on may stay so, but not come closer. On a line, only what has
        stopped the arm before counts.
        """
        for near, left in watch.unexpected:
            start = self._at_rest.get(near.pair)
            if near.other in self._places:
                least = self._stop_within if on_plan else _ON_LINE
                comes = start is None or near.gap < start - max(_NOISE[0], _NOISE[1] * start)
            else:
                # Of a small gap at its start, a planner's path keeps a part.
                half = self._stop_within if start is None else start / 2
                least, comes = min(self._stop_within, half), on_plan
            if comes and left < least:
                return near
        return None

    def remember(self, near: Approach, place: Vector) -> bool:
        """Remember what stopped a link at a place, shape (3,) [m]; return whether it did before."""
        links = self._places.setdefault(near.other, {})
        before = links.get(near.ours)
        links[near.ours] = place, near.gap
        if before is None:
            return False
        apart = float(np.linalg.norm(place - before[0]))
        return apart < _SAME_PLACE + abs(near.gap - before[1])
