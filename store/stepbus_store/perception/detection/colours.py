"""Classifies pixels by the colours of item types."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_DARK = 20.0
"""Norm of the RGB vector below which a pixel is too dark to classify."""
_ANGLE = 0.12
"""Largest angle between the RGB vectors of a pixel and its type [rad]. Light changes the norm, not
the direction: TinyRenderer's shading turns it by less than 0.02 rad."""


class Palette:
    """Separates the colours of item types from each other and from the background.

    types: colours of the item types; equal ones form one class. others: colours of everything else
    that may be visible.
    """

    def __init__(
        self,
        types: Sequence[tuple[float, float, float]],
        others: Sequence[tuple[float, float, float]],
    ) -> None:
        self.classes = list(dict.fromkeys(types))
        rest = [
            color for color in dict.fromkeys(others) if color not in self.classes and any(color)
        ]
        colors = np.array([*self.classes, *rest]).reshape(-1, 3)
        lengths = np.linalg.norm(colors, axis=1, keepdims=True)
        self._directions = (colors / lengths).astype(np.float32)

    def classify(self, rgb: NDArray[np.uint8]) -> NDArray[np.intp]:
        """Return the class of each pixel, -1 for none; rgb: shape (h, w, 3)."""
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
