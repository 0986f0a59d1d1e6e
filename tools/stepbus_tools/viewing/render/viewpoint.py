"""From where a picture is taken."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import WiringError
from stepbus_tools.viewing.scene import Messages, Scene
from stepbus_tools.viewing.stage.camera import bounds

Vector = NDArray[np.float64]

NAMED = {
    "corner": (0.62, -0.62, 0.42),
    "front": (1.0, 0.0, 0.15),
    "left": (0.0, 1.0, 0.15),
    "right": (0.0, -1.0, 0.15),
    "above": (0.0, -0.01, 1.0),
}
"""Name → direction from the middle of the scene to the eye."""


@dataclass(frozen=True, kw_only=True)
class Viewpoint:
    """eye, target: shape (3,) [m] in the world frame."""

    eye: Vector
    target: Vector

    def axes(self) -> Vector:
        """Return the unit vectors to the right, down and ahead, shape (3, 3)."""
        ahead = self.target - self.eye
        ahead = ahead / (np.linalg.norm(ahead) or 1.0)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        if float(np.linalg.norm(right)) < 1e-6:
            right = np.array((1.0, 0.0, 0.0))
        right = right / np.linalg.norm(right)
        return np.stack((right, np.cross(ahead, right), ahead))


def whole_scene(scene: Scene, messages: Messages, name: str = "corner") -> Viewpoint:
    """Return a viewpoint that sees all of a scene. name: of `NAMED`."""
    low, high = bounds(scene, messages)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    away = np.array(NAMED[name])
    away = away / np.linalg.norm(away)
    return Viewpoint(eye=middle + away * 1.15 * max(size, 0.2), target=middle)


def parse_viewpoint(text: str, scene: Scene, messages: Messages) -> Viewpoint:
    """Return the viewpoint of `corner`, …, `X,Y,Z` or `X,Y,Z:X,Y,Z`: the eye, and what it sees.

    Raises WiringError for any other text.
    """
    if text in NAMED:
        return whole_scene(scene, messages, text)
    eye, _, target = text.partition(":")
    looked_at = _numbers(target) if target else whole_scene(scene, messages).target
    seen_from = _numbers(eye)
    if seen_from is None or looked_at is None or np.allclose(seen_from, looked_at):
        raise WiringError(
            f"{text!r} is no viewpoint; write one of {', '.join(NAMED)}, or metres such as "
            "2,-2,1.5 or 2,-2,1.5:0,0,0.5 (the eye, and what it looks at)"
        )
    return Viewpoint(eye=seen_from, target=looked_at)


def _numbers(text: str) -> Vector | None:
    try:
        found = [float(word) for word in text.split(",")]
    except ValueError:
        return None
    return np.array(found) if len(found) == 3 and all(map(math.isfinite, found)) else None
