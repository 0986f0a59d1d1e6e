"""Which pixels have the colour of something that is looked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_DARK = 20.0
"""Length of red, green, blue below which a pixel has no colour to speak of."""
_ANGLE = 0.12
"""Largest angle between a pixel's colour and a kind's [rad]. Light changes the length of red,
green, blue, hardly its direction: TinyRenderer by less than 0.02 rad over all shades."""


class Palette:
    """Tells the colours of kinds from each other and from everything else.

    kinds: those that are looked for. others: of everything else that may be seen; red, green,
    blue. Equal colours of several kinds are one class.
    """

    def __init__(
        self,
        kinds: Sequence[tuple[float, float, float]],
        others: Sequence[tuple[float, float, float]],
    ) -> None:
        self.classes = list(dict.fromkeys(kinds))
        rest = [
            color for color in dict.fromkeys(others) if color not in self.classes and any(color)
        ]
        colors = np.array([*self.classes, *rest]).reshape(-1, 3)
        lengths = np.linalg.norm(colors, axis=1, keepdims=True)
        self._directions = (colors / lengths).astype(np.float32)

    def classify(self, rgb: NDArray[np.uint8]) -> NDArray[np.intp]:
        """Return the number of the class of each pixel, -1 for none; rgb: shape (h, w, 3)."""
        pixels = np.moveaxis(rgb, 2, 0).astype(np.float32)
        length = np.sqrt((pixels**2).sum(axis=0))
        best = np.cos(_ANGLE) * length
        numbers = np.full(length.shape, -1, dtype=np.intp)
        for number, direction in enumerate(self._directions):
            likeness = sum(part * plane for part, plane in zip(direction, pixels, strict=True))
            nearer = likeness > best
            best[nearer] = likeness[nearer]
            numbers[nearer] = number
        numbers[(length < _DARK) | (numbers >= len(self.classes))] = -1
        return numbers
