"""Splits a patch that shows the faces of several touching items."""

import numpy as np

from stepbus_store.perception.geometry import Vector

from .faces import Patch

_ROUNDS = 50


def split(patch: Patch, area: float) -> list[Patch]:
    """Return the parts of a patch, none if it is a single face; area: of one face [m²].

    Uses k-means, which separates equal convex faces well, initialised along the longest axis.
    """
    count = round(patch.area / area)
    if not 2 <= count <= 6:
        return []
    centres = _means(patch.points, count)
    own, of_edge = _nearest(patch.points, centres), _nearest(patch.edge, centres)
    share = patch.area / len(patch.points)
    return [
        Patch(
            height=patch.height,
            points=patch.points[own == n],
            edge=patch.edge[of_edge == n],
            area=share * float((own == n).sum()),
        )
        for n in range(count)
        if (own == n).any()
    ]


def _means(points: Vector, count: int) -> Vector:
    middle = points.mean(axis=0)
    spread = np.linalg.eigh(np.cov((points - middle).T))
    axis = spread.eigenvectors[:, -1]
    along = (points - middle) @ axis
    steps = np.quantile(along, (np.arange(count) + 0.5) / count)
    centres: Vector = middle + steps[:, None] * axis
    for _ in range(_ROUNDS):
        own = _nearest(points, centres)
        moved = np.array(
            [
                points[own == n].mean(axis=0) if (own == n).any() else c
                for n, c in enumerate(centres)
            ]
        )
        if np.array_equal(moved, centres):
            break
        centres = moved
    return centres


def _nearest(points: Vector, centres: Vector) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    away = points[:, None, :] - centres[None, :, :]
    nearest: np.ndarray[tuple[int], np.dtype[np.intp]] = (away**2).sum(axis=2).argmin(axis=1)
    return nearest
