"""What has stopped an arm: it is left first, and the arm does not start towards it again."""

from collections.abc import Sequence

import numpy as np

from stepbus_kinematics import Vector

from .findings import Approach

_SAME_PLACE = 0.02
"""Nearer than this to where a link was stopped, it is stopped for the same thing again, if it is
as near to that; faster links are stopped farther from it [m]."""

_NOISE = (2e-4, 0.1)
"""A gap that is smaller by that [m], or by that share of it, has become smaller."""

_ON_LINE = 1e-3
"""A line, which may lead close past things, ends before it is nearer than this [m]."""

Strange = Sequence[tuple[Approach, float]]
"""Pairs of the robot with something else, and what the hardest stop would leave of each gap [m]."""


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

    def update(self, strange: Strange, *, is_moving: bool) -> None:
        """Take what is sensed in a step; is_moving: the arm moves."""
        others = {near.other for near, _ in strange}
        self._places = {other: at for other, at in self._places.items() if other in others}
        if not is_moving:
            self._at_rest = {near.pair: near.gap for near, _ in strange}

    def hindrance(self, strange: Strange, *, on_plan: bool) -> Approach | None:
        """Return what the arm must stop for; None: nothing. on_plan: it is on a planner's path.

        What is close from the start on may stay so, but not come closer. On a line, only what has
        stopped the arm before counts.
        """
        for near, left in strange:
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
        """Remember what has stopped a link at a place, shape (3,) [m].

        Return whether it has stopped that link there before.
        """
        links = self._places.setdefault(near.other, {})
        before = links.get(near.ours)
        links[near.ours] = place, near.gap
        if before is None:
            return False
        apart = float(np.linalg.norm(place - before[0]))
        return apart < _SAME_PLACE + abs(near.gap - before[1])
