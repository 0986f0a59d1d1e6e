"""How much of an item is seen that should be there."""

from __future__ import annotations

import numpy as np

from stepbus_perception.geometry import Pose
from stepbus_perception.items import MARGIN, Kind

from .faces import LEVELS_APART, Mask, Scene

_CONTRADICTED = 0.15
"""Share of what is seen through where the item should be that rules the item out."""


def seen_share(scene: Scene, among: Mask, kind: Kind, pose: Pose) -> float:
    """Return the share of an item's tops that is seen, 0 to 1.

    among: where the image has the colour of the kind, shape (h, w). pose: of the item's link.
    What other things hide, or what is beyond the image, counts as not seen; what the item hides
    of itself does not count. 0: the view shows that there is no such item.
    """
    samples = kind.samples @ pose.rotation.T + pose.position
    seen, there, colored = scene.probe(samples, among)
    off = seen[:, 2] - samples[:, 2]
    right = colored & (np.abs(off) < LEVELS_APART)
    wrong = there & ~right & (off < LEVELS_APART)
    hidden = there & ~right & ~wrong
    itself = hidden & colored & _within(kind, pose, seen)
    if wrong.sum() > _CONTRADICTED * (wrong | right).sum():
        return 0.0
    return float(right.sum() / max((~itself).sum(), 1))


def _within(kind: Kind, pose: Pose, points: np.ndarray) -> Mask:
    """Return which points belong to the item itself; points: shape (n, 3) [m]."""
    local = (points - pose.position) @ pose.rotation
    beyond = np.min([face.beyond(local[:, :2]) for face in kind.faces], axis=0)
    within: Mask = (beyond < MARGIN) & (local[:, 2] < kind.faces[0].offset[2] + LEVELS_APART)
    return within
