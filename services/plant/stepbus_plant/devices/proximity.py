"""Range sensors all over the links of a robot, which measure how far things are away."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from .poses import LinkIndex
from .sensors.noise import Noise

Array = NDArray[np.float64]

_MOST, _MOST_LEVEL = 5, 13
"""Rays along each side of a link, at most; along the level side of an upright face, since a post
that stands between two rays is not seen."""
_UP = 2
"""The vertical axis."""
_START = 1e-3
"""Distance of a ray's start from the surface, so that it does not hit its own link [m]."""
_RIM = 2e-3
"""Distance of the outermost rays from the rim [m]."""
_DOWN = -0.3
"""Rise of a ray below which it looks down."""
_ASIDE = math.cos(math.radians(30.0))
"""Cosine of the angle to the normal above which a second ray is worth its time."""
_PASSES = 8
"""How many other links may hide the surface of one while its sensors are placed."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What the sensors of a link measure of another one: distance [m], and where in the world."""

    other: LinkIndex
    distance: float
    position: tuple[float, float, float]


class RangeSkin:
    """Rays from the surfaces of links: along the normal, and at rims away from the link's centre.

    client: of PyBullet. links: those with sensors. spacing: of the rays, as far as `_MOST` and
    `_MOST_LEVEL` allow [m]. reach: of the sensors [m]. noise: standard deviation, relative to the
    distance [-]. wheels: links that turn below sensors which do not.
    """

    def __init__(
        self,
        client: int,
        links: Sequence[LinkIndex],
        *,
        spacing: float,
        reach: float,
        noise: float,
        random: Noise,
        wheels: Collection[LinkIndex] = (),
    ) -> None:
        self._client, self._reach, self._noise, self._random = client, reach, noise, random
        # Before the first step, the engine's bounding boxes are those of loading.
        bullet.performCollisionDetection(client)
        self._wheels = frozenset(wheels)
        self._rays = {link: self._place(link, spacing) for link in links}
        self._readings = 0

    def look_up(self, links: Collection[LinkIndex]) -> None:
        """Take the sensors of links away that look down at the ground that the robot stands on."""
        for link in links:
            starts, directions = self._rays[link]
            up = (directions @ self._frame(link)[1].T)[:, 2] > _DOWN
            self._rays[link] = starts[up], directions[up]

    def _place(self, link: LinkIndex, spacing: float) -> tuple[Array, Array]:
        """Return starts and directions of a link's rays in its frame, each of shape (n, 3)."""
        low, high = (np.array(corner) for corner in bullet.getAABB(*link, self._client))
        centre, starts, directions = (low + high) / 2, [], []
        for axis, sign in product(range(3), (-1.0, 1.0)):
            for line, is_rim in _grid(low, high, axis, spacing):
                hit = self._surface(link, *_through(line, axis, sign, low, high))
                if hit is None:
                    continue
                at, normal = hit
                starts.append(at)
                directions.append(normal)
                away = at - centre
                away /= max(float(np.linalg.norm(away)), 1e-9)
                if is_rim and away @ normal < _ASIDE:
                    starts.append(at)
                    directions.append(away)
        position, turn = self._frame(link)
        points, along = np.array(starts).reshape(-1, 3), np.array(directions).reshape(-1, 3)
        return (points - position) @ turn, along @ turn

    def _surface(self, link: LinkIndex, start: Array, end: Array) -> tuple[Array, Array] | None:
        """Return where a line that comes from outside meets a link, and the normal there."""
        onwards = _START * np.sign(end - start)
        for _ in range(_PASSES):
            rows = bullet.rayTest(start.tolist(), end.tolist(), physicsClientId=self._client)
            body, number, _, at, normal = rows[0]
            if (body, number) == link:
                return np.array(at), np.array(normal)
            if body < 0:
                return None
            start = np.array(at) + onwards
        return None

    def _frame(self, link: LinkIndex) -> tuple[Array, Array]:
        """Return position and axes of a link's frame in the world, shape (3,) and (3, 3)."""
        body, number = link
        if number < 0:
            position, turn = bullet.getBasePositionAndOrientation(body, self._client)
        else:
            # Without, it lags by a physics step unless somebody else has asked for it.
            position, turn = bullet.getLinkState(
                body, number, computeForwardKinematics=True, physicsClientId=self._client
            )[4:6]
        if link in self._wheels:
            # Its sensors are on the fender: they do not turn.
            turn = bullet.getBasePositionAndOrientation(body, self._client)[1]
        return np.array(position), np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3))

    def sense(
        self, around: Mapping[LinkIndex, Sequence[LinkIndex]]
    ) -> Iterator[tuple[LinkIndex, Reading]]:
        """Yield what each of some links measures of each other body's link: the nearest point.

        around: links → what is near them at all; rays that cannot meet that are not cast.
        """
        self._readings += 1
        if not around:
            return
        owners, rays = self._segments(around)
        if not owners:
            return
        hits = bullet.rayTestBatch(
            rays[0].tolist(), rays[1].tolist(), numThreads=1, physicsClientId=self._client
        )
        noise = self._random.at(self._readings).normal(1.0, self._noise, len(owners)).tolist()
        nearest: dict[tuple[LinkIndex, LinkIndex], Reading] = {}
        for link, (body, number, share, at, _), factor in zip(owners, hits, noise, strict=True):
            if body < 0 or body == link[0]:
                continue
            distance = max((_START + share * (self._reach - _START)) * factor, 0.0)
            other = (body, number)
            known = nearest.get((link, other))
            if known is None or distance < known.distance:
                nearest[link, other] = Reading(other=other, distance=distance, position=at)
        for (link, _), reading in nearest.items():
            yield link, reading

    def _segments(
        self, around: Mapping[LinkIndex, Sequence[LinkIndex]]
    ) -> tuple[list[LinkIndex], Array]:
        """Return rays that may meet what is near their link: the links, starts and ends [m].

        The array has shape (2, n, 3).
        """
        links = list(around)
        rows = [self._rays[link] for link in links]
        owner = np.repeat(np.arange(len(links)), [len(starts) for starts, _ in rows])
        positions, turns = map(np.array, zip(*map(self._frame, links), strict=True))
        turned = turns[owner]
        along = np.einsum("nij,nj->ni", turned, np.concatenate([row for _, row in rows]))
        starts = np.einsum("nij,nj->ni", turned, np.concatenate([row for row, _ in rows]))
        starts += positions[owner] + _START * along
        rays = np.array([starts, starts + (self._reach - _START) * along])
        cast = np.flatnonzero(self._may_meet(rays, owner, list(around.values())))
        return [links[n] for n in owner[cast].tolist()], rays[:, cast]

    def _may_meet(
        self, rays: Array, owner: NDArray[np.intp], near: Sequence[Sequence[LinkIndex]]
    ) -> NDArray[np.bool_]:
        """Return of each ray whether its bounding box meets one of a thing near its owner.

        near: for each owner.
        """
        things = {thing: n for n, thing in enumerate(dict.fromkeys(chain.from_iterable(near)))}
        is_near = np.zeros((len(near), len(things)), dtype=bool)
        for n, row in enumerate(near):
            is_near[n, [things[thing] for thing in row]] = True
        boxes = np.array([bullet.getAABB(*thing, self._client) for thing in things])
        low, high = rays.min(axis=0), rays.max(axis=0)
        meets = is_near[owner]
        for axis in range(3):
            meets &= low[:, axis, None] <= boxes[:, 1, axis]
            meets &= high[:, axis, None] >= boxes[:, 0, axis]
        return np.asarray(meets.any(axis=1))


def _grid(low: Array, high: Array, axis: int, spacing: float) -> Iterator[tuple[Array, bool]]:
    """Yield points of a grid across an axis, and whether they are at its rim."""
    sides = [side for side in range(3) if side != axis]
    most = [_MOST_LEVEL if _UP not in {axis, side} else _MOST for side in sides]
    ticks = [_ticks(low[n], high[n], spacing, m) for n, m in zip(sides, most, strict=True)]
    for (m, first), (n, second) in product(*(enumerate(row) for row in ticks)):
        point = np.zeros(3)
        point[sides[0]], point[sides[1]] = first, second
        yield point, m in (0, len(ticks[0]) - 1) or n in (0, len(ticks[1]) - 1)


def _through(line: Array, axis: int, sign: float, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the ends of a line through a box along an axis, from outside."""
    start, end = line.copy(), line.copy()
    ends = (high[axis] + _START, low[axis] - _START)
    start[axis], end[axis] = ends if sign > 0 else ends[::-1]
    return start, end


def _ticks(low: float, high: float, spacing: float, most: int) -> list[float]:
    count = min(math.ceil((high - low) / spacing) + 1, most)
    ticks: list[float] = np.linspace(low + _RIM, high - _RIM, count).tolist()
    return ticks
