"""How much of a candidate item is visible."""

import numpy as np

from stepbus_store.perception.catalog import MARGIN, ItemType
from stepbus_store.perception.geometry import Pose

from .faces import LEVELS_APART, Mask, Scene

_CONTRADICTED = 0.15
"""An item is ruled out if the camera sees through more than this share of its top faces."""


def visible_share(scene: Scene, among: Mask, item_type: ItemType, pose: Pose) -> float:
    """Return the visible share of an item's top faces, 0 to 1.

    among: pixels with the colour of the type, shape (h, w). pose: of the item's link. What other
    objects occlude, and what is outside the image, is not visible; what the item itself occludes
    does not count. 0: the view shows that there is no such item.
    """
    samples = item_type.samples @ pose.rotation.T + pose.position
    seen, there, colored = scene.probe(samples, among)
    off = seen[:, 2] - samples[:, 2]
    right = colored & (np.abs(off) < LEVELS_APART)
    wrong = there & ~right & (off < LEVELS_APART)
    hidden = there & ~right & ~wrong
    itself = hidden & colored & _within(item_type, pose, seen)
    if wrong.sum() > _CONTRADICTED * (wrong | right).sum():
        return 0.0
    return float(right.sum() / max((~itself).sum(), 1))


def _within(item_type: ItemType, pose: Pose, points: np.ndarray) -> Mask:
    """Return which points, shape (n, 3) [m], belong to the item itself."""
    local = (points - pose.position) @ pose.rotation
    beyond = np.min([face.beyond(local[:, :2]) for face in item_type.faces], axis=0)
    within: Mask = (beyond < MARGIN) & (local[:, 2] < item_type.faces[0].offset[2] + LEVELS_APART)
    return within
