"""The numbers of a page: thinned, written once each, as base64."""

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

from stepbus_orchestrator.toolkit import Array

_MOST_POINTS = 2000


class Arrays:
    """All arrays of a page; equal ones, such as the times of most lines, are there once."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}

    def line(
        self, label: str, t: Array, values: Array, style: Mapping[str, object] = {}
    ) -> Mapping[str, Any]:
        """Return a line of a chart; t: [s], values: both of shape (p,). style: for the script."""
        t, values = thin(t, values)
        at, y = self._place(b"d", t.astype("<f8")), self._place(b"f", values.astype("<f4"))
        return {"label": label, "t": at, "y": y, **style}

    @staticmethod
    def has(line: tuple[Array, Array] | None) -> bool:
        """Return whether a line has any number."""
        return line is not None and bool(np.isfinite(line[1]).any())

    def encoded(self) -> list[str]:
        """Return each array: `d` or `f`, then its little-endian numbers as base64."""
        return [data[:1].decode() + base64.b64encode(data[1:]).decode() for data in self._places]

    def _place(self, form: bytes, values: Array) -> int:
        return self._places.setdefault(form + values.tobytes(), len(self._places))


def thin(t: Array, values: Array, most: int = _MOST_POINTS) -> tuple[Array, Array]:
    """Return at most so many points, with the least and the largest of each bucket in order."""
    finite = np.where(np.isfinite(values), values, np.nan)
    if len(t) <= most:
        return t, finite
    edges = np.linspace(0, len(t), most // 2 + 1).astype(int)[:-1]
    owner = np.repeat(np.arange(len(edges)), np.diff([*edges, len(t)]))
    low, high = (
        np.lexsort((sign * np.where(np.isnan(finite), np.inf * sign, finite), owner))[edges]
        for sign in (1, -1)
    )
    rows = np.sort(np.stack((low, high), axis=1), axis=1).ravel()
    return t[rows], finite[rows]
