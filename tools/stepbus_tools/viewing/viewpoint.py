"""What moves in a scene, and from where it is seen: by name, by coordinates, or all of it."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import WiringError
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.scene.pose import Pose, rotated
from stepbus_tools.viewing.scene.scene import Messages, Scene

Box = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lower and upper corner, shape (3,) [m]."""

FLOOR_M = 8.0
"""What is as large is a floor: it has shadows, and is not among what is looked at."""
_UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_MOVED_M = 0.01
_LOOKS = 24


class Swept:
    """The box of all that moves, over the times that it has taken.

    It is that of the whole scene while nothing moves.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._solids = list(_solids(scene))
        self._first: dict[str, Box] = {}
        self._moving: set[str] = set()
        self._swept: Box | None = None
        self._parts: list[tuple[str, Box]] = []

    @property
    def box(self) -> Box:
        """Return the box to look at."""
        return self._swept if self._swept is not None else (np.full(3, -1.0), np.full(3, 1.0))

    @property
    def fixed(self) -> NDArray[np.float64]:
        """Return the boxes of bodies at rest, once another body has moved.

        Shape (n, 2, 3) [m]: lower and upper corners.
        """
        rows = [box for body, box in self._parts if self._moving and body not in self._moving]
        return np.array(rows).reshape(-1, 2, 3)

    def take(self, messages: Messages) -> None:
        """Take where the scene is at another time."""
        boxes = self._boxes(messages)
        self._first = boxes | self._first
        moved = {body for body in boxes if apart(self._first[body], boxes[body]) > _MOVED_M}
        if moved and not self._moving:
            # What has been shown so far was all that is there.
            self._swept = None
        self._moving |= moved
        shown = self._moving & boxes.keys() or boxes.keys()
        rows = [box for body in shown for box in (boxes[body], self._first[body])]
        rows += [] if self._swept is None else [self._swept]
        self._swept = _union(rows) if rows else None

    def _boxes(self, messages: Messages) -> dict[str, Box]:
        """Return body → its box."""
        poses = self._scene.world_poses(messages)
        boxes: dict[str, list[Box]] = {}
        self._parts = []
        for frame, body, pose, half in self._solids:
            placed = poses[frame] @ pose
            reach = np.abs(rotation(placed)) @ half
            middle = np.array(placed.position)
            self._parts.append((body, (middle - reach, middle + reach)))
            boxes.setdefault(body, []).append(self._parts[-1][1])
        return {body: _union(rows) for body, rows in boxes.items()}


def swept(scene: Scene, history: History, start_ns: int = 0, end_ns: int | None = None) -> Swept:
    """Return the swept box between two times [ns], by default of the whole run."""
    found, last = Swept(scene), history.end_ns if end_ns is None else end_ns
    for t_ns in np.linspace(start_ns, last, _LOOKS + 1, dtype=np.int64).tolist():
        found.take(history.at(scene.topics, t_ns))
    return found


def _solids(scene: Scene) -> Iterator[tuple[str, str, Pose, NDArray[np.float64]]]:
    """Yield (frame, body, pose of the middle in the frame, half size [m]) of each solid."""
    for frame in scene.frames:
        for visual in () if frame.is_ghost else frame.visuals:
            low, high = visual.mesh.vertices.min(axis=0), visual.mesh.vertices.max(axis=0)
            if float((high - low).max()) < FLOOR_M:
                x, y, z = ((low + high) / 2).tolist()
                half = np.asarray((high - low) / 2, dtype=np.float64)
                yield frame.name, frame.body, visual.pose @ Pose((x, y, z)), half


def _union(boxes: Sequence[Box]) -> Box:
    lows, highs = zip(*boxes, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def apart(a: Box, b: Box) -> float:
    """Return how far the corners of two boxes are apart at most [m]."""
    return float(max(np.abs(a[0] - b[0]).max(), np.abs(a[1] - b[1]).max()))


Floats = NDArray[np.float64]

FIELD_OF_VIEW = 0.9
"""Of the height [rad]."""
MARGIN = 0.9
"""How much of a picture is filled."""
Part = tuple[tuple[float, float], tuple[float, float]]
"""Of a picture: from left to right and from below to above, −1 to 1."""
WHOLE: Part = ((-MARGIN, MARGIN), (-MARGIN, MARGIN))
_NEAREST_M = 1e-3
_SIDES = {
    "corner": (0.62, -0.62, 0.42),
    "front": (1.0, 0.0, 0.15),
    "left": (0.0, 1.0, 0.15),
    "right": (0.0, -1.0, 0.15),
    "above": (0.0, -0.01, 1.0),
}
"""Name → direction from the middle of the scene to the eye."""
_CORNERS = [(0.62 * x, 0.62 * y, 0.42) for y in (-1, 1) for x in (1, -1)]
"""The first is that of `corner` where nothing is in the way."""
_NOTHING = np.zeros((0, 2, 3))
_SAMPLES = (np.array(list(product(range(6), repeat=3))) + 0.5) / 6
_SHARES = 50
"""Corners that hide the same of so many shares are as good as each other."""
_EYE = 1.4
"""How far away the eye is taken to be, of the size of what is seen."""


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


def framed(
    box: Box,
    side: str = "corner",
    *,
    fixed: Floats = _NOTHING,
    aspect: float = 1.5,
    fov: float = FIELD_OF_VIEW,
    free: Part = WHOLE,
) -> Viewpoint:
    """Return the nearest viewpoint that has a box in a part of its picture.

    side: where from, such as `front`. fixed: of `Swept`, what may be in the way of a corner.
    aspect: width over height. fov: of the height [rad].
    """
    low, high = box
    middle = (low + high) / 2
    towards = clear_corner(box, fixed) if side == "corner" else np.array(_SIDES[side])
    right, down, ahead = Viewpoint(eye=towards, target=np.zeros(3)).axes()
    rows = (np.array(list(product((-1, 1), repeat=3))) * (high - low) / 2) @ np.stack(
        (right, -down, ahead)
    ).T
    slopes, ends = math.tan(fov / 2) * np.array([aspect, 1.0]), np.array(free)
    # A corner is in that part where the eye's shift lies between two values, both linear in the
    # distance: where the largest lower one meets the smallest upper one, the eye is nearest.
    low_end, high_end = slopes * ends.T
    least = (rows[:, :2] - rows[:, 2:] * high_end).max(axis=0)
    most = (rows[:, :2] - rows[:, 2:] * low_end).min(axis=0)
    distances = (least - most) / (high_end - low_end)
    far = max(float(distances.max()), float(-rows[:, 2].min()) + _NEAREST_M)
    shift = (least - far * high_end + most - far * low_end) / 2
    eye = middle + shift @ np.stack((right, -down)) - far * ahead
    return Viewpoint(eye=eye, target=eye + far * ahead)


def clear_corner(box: Box, fixed: Floats) -> Floats:
    """Return the direction to the corner from which fixed boxes hide least of a box, shape (3,)."""
    low, high = box
    points = low + _SAMPLES * (high - low)

    def hidden(corner: tuple[float, float, float]) -> int:
        eye = (low + high) / 2 + _EYE * size_of(box) * np.array(corner) / np.linalg.norm(corner)
        rays = points - eye
        rays[rays == 0] = 1e-12
        ends = (fixed[:, :, None] - eye) / rays
        enter, leave = ends.min(axis=1).max(axis=2), ends.max(axis=1).min(axis=2)
        is_hit = (enter < leave) & (enter < 1) & (leave > 0)
        return round(_SHARES * float(is_hit.any(axis=0).mean()))

    return np.array(min(_CORNERS, key=hidden))


def size_of(box: Box) -> float:
    """Return the diagonal of a box, at least a millimetre [m]."""
    return max(1e-3, float(np.linalg.norm(box[1] - box[0])))


def parse_viewpoint(
    text: str, box: Box, aspect: float = 1.5, fixed: Floats = _NOTHING
) -> Viewpoint:
    """Return the viewpoint of `corner`, …, `X,Y,Z` or `X,Y,Z:X,Y,Z` (eye, and target).

    box, aspect, fixed: as of `framed`. Raises WiringError for any other text.
    """
    if text in _SIDES:
        return framed(box, text, aspect=aspect, fixed=fixed)
    eye, _, target = text.partition(":")
    looked_at = _point(target) if target else (box[0] + box[1]) / 2
    seen_from = _point(eye)
    if seen_from is None or looked_at is None or np.allclose(seen_from, looked_at):
        raise WiringError(
            f"{text!r} is not a viewpoint; write one of {', '.join(_SIDES)}, or metres "
            "such as 2,-2,1.5 or 2,-2,1.5:0,0,0.5 (the camera position, and the point it "
            "looks at)"
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
    return np.array([rotated(pose.wxyz, axis) for axis in _UNITS]).T
