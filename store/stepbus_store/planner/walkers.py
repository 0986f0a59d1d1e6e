"""Who walks among what the lidars see: how fast, and how near the base will be."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import BaseState, Point
from stepbus_store.planner.outline import Outline, distances
from stepbus_store.planner.params import Params
from stepbus_store.poses import wrapped

_AGO, _SHORTEST = 0.2, 0.09
"""Over which time the velocity of a thing is measured, and at least [s]."""

_SAME = 0.3
"""Nearer to where something was, it may be the same thing [m]."""

_WALKS, _NOISE, _ALIKE = 0.1, 0.03, 0.6
"""Velocity from which it moves [m/s], how far noise moves its sides [m], and of how far one side
moves, the least share by which the other one does."""

_PAUSES = 3.0
"""Whoever has walked stands only for a moment, for that long [s]."""

_TIMES = np.arange(0.0, 3.01, 0.1)
"""For how long whoever walks is expected to walk on like that [s]."""

_MARGIN, _PER_SPEED = 0.25, 0.15
"""Least distance between the base and whoever walks, and how much more for each m/s [m, s]."""

_TOUCHES = 0.05
"""Expected distance that may be a touch: a velocity is not exact [m]."""

STRIDE = 0.1
"""Of the places along a route [m]."""

_CORNER = 0.35
"""Change of the heading for which the base stops and turns [rad]."""


@dataclass(frozen=True, kw_only=True)
class Walker:
    """Something that moves; velocity: shape (2,) [m/s]."""

    outline: Outline
    velocity: Vector

    @property
    def room(self) -> float:
        """Return how far the base keeps away from it [m]."""
        return _MARGIN + _PER_SPEED * float(np.linalg.norm(self.velocity))

    def distances(self, places: Vector) -> Vector:
        """Return how far it is from places at `_TIMES`, shape (k, 2), if it goes on like that."""
        # As it sees them: it stands, and they move.
        return distances(places - _TIMES[:, None] * self.velocity, self.outline.corners)


class Walkers:
    """All that is seen, told apart: who walks, who has stopped a moment ago, and what stands."""

    def __init__(self) -> None:
        self._before: deque[tuple[float, Sequence[Outline]]] = deque()
        self._seen_walking: list[tuple[float, Vector]] = []
        self.walking: Sequence[Walker] = ()
        self.pausing: Sequence[Outline] = ()
        self.standing: Sequence[Outline] = ()

    def look(self, things: Sequence[Outline], t: float) -> None:
        """Take what is seen at a time [s]."""
        while len(self._before) > 1 and self._before[1][0] <= t - _AGO:
            self._before.popleft()
        walking, pausing, standing = [], [], []
        known = [row for row in self._seen_walking if row[0] > t - _PAUSES]
        for thing in things:
            middle = thing.corners.mean(axis=0)
            velocity = _velocity(thing, tuple(self._before), t)
            if velocity.any():
                walking.append(Walker(outline=thing, velocity=velocity))
            elif any(np.linalg.norm(at - middle) < _SAME for _, at in known):
                pausing.append(thing)
            else:
                standing.append(thing)
        self._before.append((t, things))
        known += [(t, row.outline.corners.mean(axis=0)) for row in walking]
        self._seen_walking = known
        self.walking, self.pausing, self.standing = walking, pausing, standing

    def all(self) -> list[Outline]:
        """Return all that is seen."""
        return [*(who.outline for who in self.walking), *self.pausing, *self.standing]

    def snapshot(self) -> Walkers:
        """Return the same, which later looks do not change."""
        return copy(self)

    def safety(self, places: Vector, radius: float) -> float:
        """Return how safe it is to be at places at `_TIMES`, shape (k, 2).

        0 or more: nobody comes too near to a disc of that radius [m]. Below 0: the less, the nearer
        somebody comes, and below -1 the sooner he may touch it.
        """
        return min((_safety(who.distances(places) - radius, who.room) for who in self.walking),
                   default=0.0)  # fmt: skip


def _safety(gaps: Vector, room: float) -> float:
    touching = np.flatnonzero(gaps < _TOUCHES)
    if len(touching):
        return -1.0 - float(_TIMES[-1] - _TIMES[touching[0]])
    return min(float(gaps.min()) - room, 0.0)


def _velocity(
    thing: Outline, earlier: Sequence[tuple[float, Sequence[Outline]]], t: float
) -> Vector:
    """Return how fast a thing moves, shape (2,) [m/s]; 0: it does not, or it is new.

    earlier: times, and what was seen then, the oldest first.
    """
    middle = thing.corners.mean(axis=0)
    for then, things in earlier:
        if t - then < _SHORTEST:
            break
        near = [row for row in things if distances(thing.corners, row.corners).min() < _SAME]
        if near:
            before = min(
                near, key=lambda row: float(np.linalg.norm(row.corners.mean(axis=0) - middle))
            )
            return _moved(thing, before, t - then)
    return np.zeros(2)


def _moved(thing: Outline, before: Outline, seconds: float) -> Vector:
    """Return a velocity; both sides have to move: more of what stands is seen from nearby."""
    low, high = thing.sides - before.sides
    less, more = np.minimum(np.abs(low), np.abs(high)), np.maximum(np.abs(low), np.abs(high))
    is_alike = (low * high > 0.0) & (less > _ALIKE * more - _NOISE)
    both = np.where(is_alike, np.copysign(less, low), 0.0)
    is_moved = float(np.linalg.norm(both)) > _WALKS * seconds + _NOISE
    return both / seconds if is_moved else np.zeros(2)


def places_along(route: Sequence[Point]) -> Vector:
    """Return places along a route, at most 0.1 m apart: x, y, turn on the spot before [m, rad]."""
    rows = [(*route[0][:2], 0.0)]
    for (ax, ay, yaw), (bx, by, _) in pairwise(route):
        length = math.hypot(bx - ax, by - ay)
        if length < 1e-3:
            continue
        ahead = abs(wrapped(math.atan2(by - ay, bx - ax) - yaw))
        turn = min(ahead, math.pi - ahead)
        count = max(math.ceil(length / STRIDE), 1)
        for n in range(1, count + 1):
            x, y = ax + (bx - ax) * n / count, ay + (by - ay) * n / count
            rows.append((x, y, turn if n == 1 and turn > _CORNER else 0.0))
    return np.array(rows)


def going(places: Vector, speed: float, params: Params) -> Vector:
    """Return where the base is at `_TIMES` if it drives along places, shape (k, 2) [m].

    places: of `places_along`, from where it is on. speed: that it has [m/s].
    """
    at, t = [0.0], 0.0
    for (ax, ay, _), (bx, by, turn) in pairwise(places.tolist()):
        if turn:
            t, speed = t + turn / params.base_turn_speed, 0.0
        length = math.hypot(bx - ax, by - ay)
        faster = math.sqrt(speed**2 + 2.0 * params.base_acceleration * length)
        faster = min(faster, params.base_speed)
        t += 2.0 * length / max(speed + faster, 1e-3)
        speed = faster
        at.append(t)
    return np.stack([np.interp(_TIMES, at, places[:, n]) for n in (0, 1)], axis=1)


def braking(base: BaseState) -> Vector:
    """Return where a base is at `_TIMES` if it brakes now, shape (k, 2) [m]."""
    # It brakes with 4 m/s² after a tenth of a second.
    far = base.vx * 0.1 + math.copysign(base.vx**2, base.vx) / 8.0
    place = (base.x + far * math.cos(base.yaw), base.y + far * math.sin(base.yaw))
    return np.tile(place, (len(_TIMES), 1))
