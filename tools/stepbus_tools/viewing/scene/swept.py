"""What moves in a scene, and how far: what a page, a picture and a film of it show."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from stepbus_tools.viewing.history import History

from .bodies import Messages
from .pose import Pose, rotated
from .scene import Scene

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
        """Return what is to be seen."""
        return self._swept if self._swept is not None else (np.full(3, -1.0), np.full(3, 1.0))

    @property
    def fixed(self) -> NDArray[np.float64]:
        """Return the boxes of what has not moved so far, while other things have.

        Shape (n, 2, 3) [m]: lower and upper corners.
        """
        rows = [box for body, box in self._parts if self._moving and body not in self._moving]
        return np.array(rows).reshape(-1, 2, 3)

    def take(self, messages: Messages) -> None:
        """Take where the scene is at another time."""
        boxes = self._boxes(messages)
        for body, box in boxes.items():
            if (
                body not in self._moving
                and apart(self._first.setdefault(body, box), box) > _MOVED_M
            ):
                # What has been shown so far was all that is there.
                self._swept = self._swept if self._moving else None
                self._moving.add(body)
        moving = self._moving & boxes.keys() or boxes.keys()
        rows = [box for body in moving for box in (boxes[body], self._first[body])]
        if self._swept is not None:
            rows.append(self._swept)
        if rows:
            self._swept = _union(rows)

    def _boxes(self, messages: Messages) -> dict[str, Box]:
        """Return body → its box."""
        poses = self._scene.world_poses(messages)
        boxes: dict[str, list[Box]] = {}
        self._parts = []
        for frame, body, pose, half in self._solids:
            placed = poses[frame] @ pose
            turn = np.array([rotated(placed.wxyz, axis) for axis in _UNITS])
            reach = half @ np.abs(turn)
            middle = np.array(placed.position)
            self._parts.append((body, (middle - reach, middle + reach)))
            boxes.setdefault(body, []).append(self._parts[-1][1])
        return {body: _union(rows) for body, rows in boxes.items()}


def swept(scene: Scene, history: History, start_ns: int = 0, end_ns: int | None = None) -> Swept:
    """Return what moves from one time to another [ns], by default the whole run."""
    found, last = Swept(scene), history.end_ns if end_ns is None else end_ns
    for t_ns in np.linspace(start_ns, last, _LOOKS + 1, dtype=np.int64).tolist():
        found.take(history.at(scene.topics, t_ns))
    return found


def _solids(scene: Scene) -> Iterator[tuple[str, str, Pose, NDArray[np.float64]]]:
    """Yield what is seen: frame, body, pose of its middle in the frame, half of its size [m]."""
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
