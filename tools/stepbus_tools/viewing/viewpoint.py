"""Where a scene is seen from: viewpoints by name or by coordinates, and what fits the picture."""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import WiringError
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.scene.bodies import Messages
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Scene, bounds

Floats = NDArray[np.float64]

FIELD_OF_VIEW = 0.9
"""Of the height [rad]."""
_FLOOR_M = 8.0
_LOOKS = 25
"""Times at which a film's viewpoint is chosen for."""
_MARGIN = 0.86
"""How much of the picture is filled."""
_SIDES = {
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

    eye: Floats
    target: Floats

    def axes(self) -> Floats:
        """Return the unit vectors to the right, down and ahead, shape (3, 3)."""
        ahead = self.target - self.eye
        ahead = ahead / (np.linalg.norm(ahead) or 1.0)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        if float(np.linalg.norm(right)) < 1e-6:
            right = np.array((1.0, 0.0, 0.0))
        right = right / np.linalg.norm(right)
        return np.stack((right, np.cross(ahead, right), ahead))


Box = tuple[Floats, Floats]
"""The lower and upper corner of what is shown, shape (3,) each [m]."""


def whole_scene(scene: Scene, messages: Messages, side: str = "corner") -> Viewpoint:
    """Return a viewpoint that sees all of a scene. side: where from, such as `front`."""
    return framed(bounds(scene, messages), side)


def box_of_run(scene: Scene, history: History, start_ns: int, end_ns: int) -> Box:
    """Return what a scene takes up from one time to another [ns].

    A floor does not count, nor what is far from most things, such as a crate in a far corner.
    """
    frames = [frame for frame in scene.frames if frame.visuals and not frame.is_ghost]
    corners = {frame.name: _corners(frame) for frame in frames}
    corners = {
        name: rows for name, rows in corners.items() if np.ptp(rows, axis=0).max() < _FLOOR_M
    }
    ends = []
    for t_ns in np.linspace(start_ns, end_ns, _LOOKS, dtype=np.int64).tolist():
        messages = history.at(scene.topics, t_ns)
        poses = scene.world_poses(messages)
        low, high = bounds(scene, messages)
        middle, size = (low + high) / 2, float((high - low).max())
        placed = [moved(rows, poses[name]) for name, rows in corners.items()]
        kept = [rows for rows in placed if np.abs(rows.mean(axis=0) - middle).max() <= size]
        points = np.concatenate(kept) if kept else np.stack((low, high))
        ends.append((points.min(axis=0), points.max(axis=0)))
    return np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)


def _corners(frame: Frame) -> Floats:
    """Return the corners of the boxes around what a frame looks like, shape (n, 3) [m]."""
    boxes = []
    for visual in frame.visuals:
        vertices = visual.mesh.vertices.astype(float)
        sides = zip(vertices.min(axis=0), vertices.max(axis=0), strict=True)
        boxes.append(moved(np.array(list(product(*sides))), visual.pose))
    return np.concatenate(boxes)


def framed(box: Box, side: str = "corner", aspect: float = 1.5) -> Viewpoint:
    """Return the nearest viewpoint that has a box in the picture.

    side: where from, such as `front`. aspect: width over height.
    """
    low, high = box
    middle = (low + high) / 2
    towards = Viewpoint(eye=np.array(_SIDES[side]), target=np.zeros(3))
    corners = np.array(list(product(*zip(low, high, strict=True)))) - middle
    right, down, ahead = (corners @ towards.axes().T).T
    half = _MARGIN * math.tan(FIELD_OF_VIEW / 2)
    away = np.maximum(np.abs(right) / (aspect * half), np.abs(down) / half) - ahead
    return Viewpoint(eye=middle - towards.axes()[2] * max(float(away.max()), 0.25), target=middle)


def parse_viewpoint(text: str, box: Box, aspect: float = 1.5) -> Viewpoint:
    """Return the viewpoint of `corner`, …, `X,Y,Z` or `X,Y,Z:X,Y,Z`: the eye, and what it sees.

    box, aspect: as of `framed`. Raises WiringError for any other text.
    """
    if text in _SIDES:
        return framed(box, text, aspect)
    eye, _, target = text.partition(":")
    looked_at = _point(target) if target else (box[0] + box[1]) / 2
    seen_from = _point(eye)
    if seen_from is None or looked_at is None or np.allclose(seen_from, looked_at):
        raise WiringError(
            f"{text!r} is no viewpoint; write one of {', '.join(_SIDES)}, or metres such as "
            "2,-2,1.5 or 2,-2,1.5:0,0,0.5 (the eye, and what it looks at)"
        )
    return Viewpoint(eye=seen_from, target=looked_at)


def _point(text: str) -> Floats | None:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        return None
    return np.array(numbers) if len(numbers) == 3 and all(map(math.isfinite, numbers)) else None


def moved(points: Floats, pose: Pose) -> Floats:
    """Return points of a frame in its parent."""
    placed: Floats = points @ rotation(pose).T + np.array(pose.position)
    return placed


def rotation(pose: Pose) -> Floats:
    """Return the rotation of a pose as a matrix, shape (3, 3)."""
    w, x, y, z = pose.wxyz
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )
