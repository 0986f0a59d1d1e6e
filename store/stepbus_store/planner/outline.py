"""Convex outlines on the floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import Vector


@dataclass(frozen=True, kw_only=True)
class Outline:
    """A convex outline on the floor; corners: shape (k, 2), counter-clockwise [m]."""

    link: str
    corners: Vector


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
    ends = np.roll(corners, -1, axis=0)
    edges = ends - corners
    offsets = points[:, None, :] - corners
    lengths = np.maximum((edges**2).sum(axis=1), 1e-18)
    shares = np.clip((offsets * edges).sum(axis=2) / lengths, 0.0, 1.0)
    away: Vector = np.linalg.norm(offsets - shares[..., None] * edges, axis=2).min(axis=1)
    crosses = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]
    away[(crosses >= 0.0).all(axis=1)] = 0.0
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
