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
_NEAREST_M = 0.25
_ROUNDS = 8
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


def whole_scene(scene: Scene, messages: Messages, side: str = "corner") -> Viewpoint:
    """Return a viewpoint that sees all of a scene. side: where from, such as `front`."""
    low, high = bounds(scene, messages)
    return framed(np.array(list(product(*zip(low, high, strict=True)))), side)


def points_of_run(scene: Scene, history: History, start_ns: int, end_ns: int) -> Floats:
    """Return corners of all that a scene takes up from one time to another [ns], shape (n, 3) [m].

    A floor does not count, nor what is far from most things, such as a crate in a far corner.
    """
    frames = [frame for frame in scene.frames if frame.visuals and not frame.is_ghost]
    corners = {frame.name: _corners(frame) for frame in frames}
    corners = {
        name: rows for name, rows in corners.items() if np.ptp(rows, axis=0).max() < _FLOOR_M
    }
    points = []
    for t_ns in np.linspace(start_ns, end_ns, _LOOKS, dtype=np.int64).tolist():
        messages = history.at(scene.topics, t_ns)
        poses = scene.world_poses(messages)
        low, high = bounds(scene, messages)
        middle, size = (low + high) / 2, float((high - low).max())
        placed = [moved(rows, poses[name]) for name, rows in corners.items()]
        kept = [rows for rows in placed if np.abs(rows.mean(axis=0) - middle).max() <= size]
        points += kept or [np.stack((low, high))]
    return np.concatenate(points)


def box_of(points: Floats) -> tuple[Floats, Floats]:
    """Return the lower and the upper corner of the box around points."""
    return points.min(axis=0), points.max(axis=0)


def framed(points: Floats, side: str = "corner", aspect: float = 1.5) -> Viewpoint:
    """Return the nearest viewpoint that has points in the picture, in its middle.

    points: shape (n, 3) [m]. side: where from, such as `front`. aspect: width over height.
    """
    axes = Viewpoint(eye=np.array(_SIDES[side]), target=np.zeros(3)).axes()
    tangent = _MARGIN * math.tan(FIELD_OF_VIEW / 2)
    room = np.array((aspect * tangent, tangent))
    low, high = box_of(points)
    target = (low + high) / 2
    for _ in range(_ROUNDS):
        seen = (points - target) @ axes.T
        beside, ahead = seen[:, :2], seen[:, 2:]
        away = max(float((np.abs(beside) / room - ahead).max()), _NEAREST_M)
        across = beside / (ahead + away)
        # What is seen more to one side is moved to the middle, which lets the eye come nearer.
        shift = (across.min(axis=0) + across.max(axis=0)) / 2 * away
        target = target + shift @ axes[:2]
    seen = (points - target) @ axes.T
    away = max(float((np.abs(seen[:, :2]) / room - seen[:, 2:]).max()), _NEAREST_M)
    return Viewpoint(eye=target - axes[2] * away, target=target)


def parse_viewpoint(text: str, points: Floats, aspect: float = 1.5) -> Viewpoint:
    """Return the viewpoint of `corner`, …, `X,Y,Z` or `X,Y,Z:X,Y,Z`: the eye, and what it sees.

    points, aspect: as of `framed`. Raises WiringError for any other text.
    """
    if text in _SIDES:
        return framed(points, text, aspect)
    eye, _, target = text.partition(":")
    low, high = box_of(points)
    looked_at = _point(target) if target else (low + high) / 2
    seen_from = _point(eye)
    if seen_from is None or looked_at is None or np.allclose(seen_from, looked_at):
        raise WiringError(
            f"{text!r} is no viewpoint; write one of {', '.join(_SIDES)}, or metres such as "
            "2,-2,1.5 or 2,-2,1.5:0,0,0.5 (the eye, and what it looks at)"
        )
    return Viewpoint(eye=seen_from, target=looked_at)


def _corners(frame: Frame) -> Floats:
    """Return the corners of the boxes around what a frame looks like, shape (n, 3) [m]."""
    boxes = []
    for visual in frame.visuals:
        vertices = visual.mesh.vertices.astype(float)
        sides = zip(vertices.min(axis=0), vertices.max(axis=0), strict=True)
        boxes.append(moved(np.array(list(product(*sides))), visual.pose))
    return np.concatenate(boxes)


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
