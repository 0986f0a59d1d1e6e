"""Lines of a plot, taken piece by piece: a few points that look like all of them."""

import numpy as np

from stepbus_orchestrator.toolkit import Array

Line = tuple[Array, Array]
"""Times [s] and values, both of shape (p,)."""

_MOST_POINTS = 8000


class Curve:
    """Several lines over time, in memory that does not grow with their length.

    Up to 8000 points all are there. Of more, each line has the least and the largest of each
    bucket; the buckets double whenever they are too many.
    together: the lines have their points at the same times, as the x and y of a path must.
    count: number of points that were added.
    """

    def __init__(self, *, together: bool = False) -> None:
        self.count = 0
        self._together = together
        # Both of shape (2, p, n): times and values of p points of n lines.
        self._kept: Array | None = None
        self._rest: Array | None = None
        self._bucket = 1

    def add(self, t: Array, values: Array) -> None:
        """Add points. t: shape (m,), [s]. values: shape (m, n)."""
        self.count += len(t)
        times = np.broadcast_to(t[:, None], values.shape)
        rest = self._rest = _joined(self._rest, np.stack((times, values)))
        least = 2 * values.shape[1] if self._together else 2
        if self._bucket == 1 and rest.shape[1] > _MOST_POINTS:
            self._bucket = 2 * least
        if self._bucket > 1:
            self._reduce(rest, least)

    def line(self, index: int) -> Line:
        """Return one line."""
        if self._rest is None:
            return np.empty(0), np.empty(0)
        t, values = _joined(self._kept, self._rest)[:, :, index]
        return t, values

    def _reduce(self, rest: Array, least: int) -> None:
        """Put points into buckets, of which `least` points are kept each."""
        most = _MOST_POINTS // (2 * least) * 2
        while rest.shape[1] >= self._bucket:
            held = 0 if self._kept is None else self._kept.shape[1] // least
            count = min(rest.shape[1] // self._bucket, most - held)
            full = rest[:, : count * self._bucket]
            rest = rest[:, count * self._bucket :]
            self._kept = _joined(self._kept, self._extremes(full, self._bucket))
            if held + count == most:
                self._kept = self._extremes(self._kept, 2 * least)
                self._bucket *= 2
        self._rest = rest.copy()

    def _extremes(self, points: Array, size: int) -> Array:
        """Return the least and the largest of each `size` points, in their order."""
        groups = points.reshape(2, -1, size, points.shape[2])
        filled = np.where(np.isnan(groups[1]), 0.0, groups[1])
        ends = [filled.argmin(axis=1), filled.argmax(axis=1)]
        if self._together:
            at = np.sort(np.concatenate(ends, axis=1), axis=1)[:, :, None]
        else:
            at = np.sort(np.stack(ends, axis=1), axis=1)
        at = np.broadcast_to(at, (2, *at.shape[:2], points.shape[2]))
        chosen: Array = np.take_along_axis(groups, at, axis=2)
        return chosen.reshape(2, -1, points.shape[2])


def _joined(first: Array | None, then: Array) -> Array:
    return then if first is None else np.concatenate((first, then), axis=1)
