"""Where visitors stand: their cameras show all that moves, clear of the controls, until moved."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_tools.viewing.scene.bodies import Messages
from stepbus_tools.viewing.scene.pose import Pose, rotated
from stepbus_tools.viewing.scene.scene import Scene
from stepbus_tools.viewing.stage.stage import FLOOR_M, add_floor

Box = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lower and upper corner, shape (3,) [m]."""

_AWAY = np.array([0.64, -0.64, 0.43]) / np.linalg.norm([0.64, -0.64, 0.43])
_FORWARD = -_AWAY
_RIGHT = np.cross(_FORWARD, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(_FORWARD, [0.0, 0.0, 1.0]))
_AXES = np.stack([_RIGHT, np.cross(_RIGHT, _FORWARD), _FORWARD])
_UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_PANEL_PX = 420
"""Of the controls, at the right of a page, with their margin."""
_COVERED = 0.5
"""Of a page that is higher than wide: the controls cover as much, from below (front.css)."""
_MARGIN = 0.9
Part = tuple[tuple[float, float], tuple[float, float]]
"""Of a picture: from left to right and from below to above, −1 to 1."""
WHOLE: Part = ((-_MARGIN, _MARGIN), (-_MARGIN, _MARGIN))
_MOVED_M = 0.01
_GREW = 0.05
_SAME = 1e-3


class Framing:
    """Keeps what moves in the pictures of all visitors who have not moved their camera.

    A scene in which nothing moves is shown as a whole. server: of viser.
    """

    def __init__(self, server: Any, scene: Scene) -> None:
        self._server = server
        self._scene = scene
        self._floor: Box | None = None
        self._solids = list(_solids(scene))
        self._first: dict[str, Box] = {}
        self._moving: set[str] = set()
        self._swept: Box | None = None
        self._views: dict[int, _Camera] = {}

    @property
    def box(self) -> Box:
        """Return what is to be seen."""
        return self._swept if self._swept is not None else (np.full(3, -1.0), np.full(3, 1.0))

    def sweep(self, messages: Messages) -> None:
        """Take where the scene is at another time."""
        boxes = self._boxes(messages)
        for body, box in boxes.items():
            if (
                body not in self._moving
                and _reach(self._first.setdefault(body, box), box) > _MOVED_M
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
        for frame, body, pose, half in self._solids:
            placed = poses[frame] @ pose
            turn = np.array([rotated(placed.wxyz, axis) for axis in _UNITS])
            reach = half @ np.abs(turn)
            middle = np.array(placed.position)
            boxes.setdefault(body, []).append((middle - reach, middle + reach))
        return {body: _union(rows) for body, rows in boxes.items()}

    def turn(self) -> None:
        """Place the cameras of those who have come, whose page or whose scene has grown."""
        clients = self._server.get_clients()
        self._views = {key: self._views.get(key) or _Camera() for key in clients}
        for key, client in clients.items():
            self._views[key].turn(client, self.box)
        if self._floor is None or _reach(self.box, self._floor) > _size(self._floor):
            self._floor = self.box
            add_floor(self._server.scene, *self.box)


def _solids(scene: Scene) -> Iterator[tuple[str, str, Pose, NDArray[np.float64]]]:
    """Yield what is seen: frame, body, pose of its middle in the frame, half of its size [m]."""
    for frame in scene.frames:
        for visual in () if frame.is_ghost else frame.visuals:
            low, high = visual.mesh.vertices.min(axis=0), visual.mesh.vertices.max(axis=0)
            if float((high - low).max()) < FLOOR_M:
                x, y, z = ((low + high) / 2).tolist()
                half = np.asarray((high - low) / 2, dtype=np.float64)
                yield frame.name, frame.body, visual.pose @ Pose((x, y, z)), half


class _Camera:
    """The camera of one visitor."""

    def __init__(self) -> None:
        self._ours: list[NDArray[np.float64]] = []
        self._box: Box | None = None
        self._size = (0, 0)

    def turn(self, client: Any, box: Box) -> None:
        camera = client.camera
        size = (camera.image_width, camera.image_height)
        has_grown = self._box is None or _reach(box, self._box) > _GREW * _size(box)
        if (size == self._size and not has_grown) or self._is_moved(camera.position, _size(box)):
            return
        self._box, self._size = box, size
        position, look_at = fit(box, camera.fov, size[0] / max(1, size[1]), free_part(*size))
        # It may still report where it was before.
        self._ours += [np.array(camera.position), position] if not self._ours else [position]
        with client.atomic():
            camera.position = tuple(position.tolist())
            camera.look_at = tuple(look_at.tolist())

    def _is_moved(self, position: Any, size: float) -> bool:
        rows = [float(np.linalg.norm(position - ours)) for ours in self._ours]
        return bool(rows) and min(rows) > _SAME * max(1.0, size)


def fit(box: Box, fov: float, aspect: float, free: Part = WHOLE) -> tuple[Any, Any]:
    """Return where a camera stands and what it looks at, to see a box in a part of its picture.

    fov: from below to above [rad]. aspect: width by height.
    """
    low, high = box
    middle = (low + high) / 2
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    rows = (signs * (high - low) / 2) @ _AXES.T
    rise = np.tan(fov / 2)
    slopes, ends = np.array([rise * aspect, rise]), np.array(free)

    def shifts(distance: float) -> tuple[Any, Any]:
        reach = (distance + rows[:, 2:]) * slopes
        below, above = rows[:, :2] - reach * ends[:, 1], rows[:, :2] - reach * ends[:, 0]
        return below.max(axis=0), above.min(axis=0)

    near, far = float(-rows[:, 2].min()) + 1e-3, 200.0 * _size(box)
    for _ in range(40):
        distance = (near + far) / 2
        least, most = shifts(distance)
        near, far = (near, distance) if (least <= most).all() else (distance, far)
    least, most = shifts(far)
    position = middle + ((least + most) / 2) @ _AXES[:2] - far * _FORWARD
    return position, position + far * _FORWARD


def free_part(width: int, height: int) -> Part:
    """Return what the controls leave free of a page."""
    if width < height:
        return (-_MARGIN, _MARGIN), (2 * _COVERED - 1 + (1 - _MARGIN), _MARGIN)
    right = max(0.0, 1 - 2 * _PANEL_PX / max(1, width))
    return (-_MARGIN, right - (1 - _MARGIN) / 2), (-_MARGIN, _MARGIN)


def _union(boxes: Sequence[Box]) -> Box:
    lows, highs = zip(*boxes, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _size(box: Box) -> float:
    return max(1e-3, float(np.linalg.norm(box[1] - box[0])))


def _reach(a: Box, b: Box) -> float:
    """Return how far the corners of two boxes are apart at most [m]."""
    return float(max(np.abs(a[0] - b[0]).max(), np.abs(a[1] - b[1]).max()))
