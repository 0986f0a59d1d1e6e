"""Convex outlines on the floor."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stepbus_kinematics import Vector


@dataclass(frozen=True, kw_only=True)
class Outline:
    """A convex outline on the floor; corners: shape (k, 2), counter-clockwise [m].

    top: height that it reaches up to [m]. face: least and largest x and y of what was seen of it,
    shape (2, 2) [m]; None: of the corners.
    """

    link: str
    corners: Vector
    top: float = math.inf
    face: Vector | None = None

    @property
    def sides(self) -> Vector:
        """Return least and largest x and y of what was seen of it, shape (2, 2) [m]."""
        if self.face is not None:
            return self.face
        return np.stack([self.corners.min(axis=0), self.corners.max(axis=0)])

    @cached_property
    def _box(self) -> tuple[float, float, float, float]:
        """Its least x and y, and its largest [m]."""
        return (*self.corners.min(axis=0).tolist(), *self.corners.max(axis=0).tolist())

    def may_be_near(self, low: Sequence[float], high: Sequence[float], within: float) -> bool:
        """Return False if nothing in a box can be that near; low, high: its corners, x and y [m].

        It costs a fraction of `distances`, which rounds: so it leaves a millimetre to that.
        """
        left, bottom, right, top = self._box
        within += 1e-3
        return (
            low[0] <= right + within
            and high[0] >= left - within
            and low[1] <= top + within
            and high[1] >= bottom - within
        )


def outermost(outlines: Sequence[Outline]) -> list[Outline]:
    """Return the outlines without those inside of others, as items on a shelf."""
    largest = sorted(outlines, key=lambda row: -float(np.prod(np.ptp(row.corners, axis=0))))
    kept: list[Outline] = []
    for row in largest:
        if not any((distances(row.corners, other.corners) == 0.0).all() for other in kept):
            kept.append(row)
    return kept


def distances(points: Vector, corners: Vector) -> Vector:
    """Return the distance of each point, shape (n, 2), to a convex outline; inside: 0 [m]."""
    # Column by column: NumPy is slow along an axis of two.
    corner_x, corner_y = corners.T
    edge_x, edge_y = (np.concatenate((corners[1:], corners[:1])) - corners).T
    x, y = points[:, :1] - corner_x, points[:, 1:] - corner_y
    lengths = np.maximum(edge_x * edge_x + edge_y * edge_y, 1e-18)
    shares = (x * edge_x + y * edge_y) / lengths
    np.minimum(np.maximum(shares, 0.0, out=shares), 1.0, out=shares)
    off_x, off_y = x - shares * edge_x, y - shares * edge_y
    away: Vector = np.sqrt(off_x * off_x + off_y * off_y).min(axis=1)
    away[(edge_x * y - edge_y * x >= 0.0).all(axis=1)] = 0.0
    return away


def hull(points: Vector) -> Vector:
    """Return the convex hull of points, shape (n, 2), counter-clockwise (Andrew 1979)."""
    rows = sorted({(float(x), float(y)) for x, y in points})

    def half(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for p in ordered:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], p) <= 0.0:
                kept.pop()
            kept.append(p)
        return kept

    return np.array(half(rows)[:-1] + half(rows[::-1])[:-1])


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
