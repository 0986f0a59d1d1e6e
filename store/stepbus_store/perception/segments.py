"""Segments of an image that belong together: depth without noise, colours, what is seen whole."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stepbus_store.perception.faces import LEVELS_APART, Mask, Patch, Scene
from stepbus_store.perception.images import View
from stepbus_store.perception.item_catalog import MARGIN, ItemType

_WINDOW = 7
"""Diameter of the filters' windows [pixel]."""
_WIDTH = 2.0
"""Standard deviation of their weights [pixel]."""
_SAME = 3.0
"""Depths this many deviations apart belong to different surfaces."""
_COLOR = 40.0
"""The same for colours, of 255."""
_FAR = 100.0


def denoised(view: View, noise: float) -> View:
    """Return a view after bilateral filters (Tomasi and Manduchi, 1998).

    noise: standard deviation of depth at 1 m [m]; it grows with the square of the distance. So
    the filter works on the inverse of depth, in which the noise is the same everywhere.
    """
    known = np.isfinite(view.depth) & (view.depth > 0)
    inverse = np.where(known, 1.0 / np.where(known, view.depth, 1.0), 1.0 / _FAR)
    once = cv2.bilateralFilter(inverse.astype(np.float32), _WINDOW, _SAME * noise, _WIDTH)
    twice = cv2.bilateralFilter(once, _WINDOW, _SAME * noise, _WIDTH)
    depth = np.where(known, 1.0 / twice.astype(np.float64), view.depth)
    rgb = cv2.bilateralFilter(view.rgb, 5, _COLOR, 1.5)
    return replace(view, depth=depth, rgb=np.asarray(rgb, dtype=np.uint8))


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


_CONTRADICTED = 0.15
"""An item is ruled out if the camera sees through more than this share of its top faces."""


def visible_share(scene: Scene, among: Mask, item_type: ItemType, pose: Any) -> float:
    """Return the visible share of an item's top faces, 0 to 1.

    among: pixels with the colour of the type, shape (h, w). pose: of the item's link, a
    `pinocchio.SE3`. What other objects occlude, and what is outside the image, is not visible; what
    the item itself occludes does not count. 0: the view shows that there is no such item.
    """
    samples = item_type.samples @ pose.rotation.T + pose.translation
    seen, there, colored = scene.probe(samples, among)
    off = seen[:, 2] - samples[:, 2]
    right = colored & (np.abs(off) < LEVELS_APART)
    wrong = there & ~right & (off < LEVELS_APART)
    hidden = there & ~right & ~wrong
    local = (seen - pose.translation) @ pose.rotation
    beyond = item_type.beyond(local)
    top = item_type.faces[0].offset[2] + LEVELS_APART
    itself = hidden & colored & (beyond < MARGIN) & (local[:, 2] < top)
    if wrong.sum() > _CONTRADICTED * (wrong | right).sum():
        return 0.0
    return float(right.sum() / max((~itself).sum(), 1))


_ROUNDS = (cv2.TERM_CRITERIA_COUNT, 50, 0.0)
"""When k-means ends: after 50 rounds."""


def split(patch: Patch, area: float) -> list[Patch]:
    """Return the parts of a patch, none if it is a single face; area: of one face [m²].

    Uses k-means, which separates equal convex faces well, initialised along the longest axis.
    """
    count = round(patch.area / area)
    if not 2 <= count <= 6:
        return []
    spread = np.linalg.eigh(np.cov((patch.points - patch.points.mean(axis=0)).T))
    along = patch.points @ spread.eigenvectors[:, -1]
    first = np.searchsorted(np.quantile(along, np.arange(1, count) / count), along)
    _, labels, centres = cv2.kmeans(
        patch.points.astype(np.float32), count, first.astype(np.int32), _ROUNDS, 1,
        cv2.KMEANS_USE_INITIAL_LABELS,
    )  # fmt: skip
    own, edge = labels.ravel(), patch.edge[:, None, :] - centres[None, :, :]
    of_edge = (edge**2).sum(axis=2).argmin(axis=1)
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
