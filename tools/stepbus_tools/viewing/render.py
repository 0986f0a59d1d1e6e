"""Draws a scene into pixels: where it is seen from, its triangles, and a still of a recording."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Image, StepbusError, WiringError
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.scene.bodies import Messages
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Scene, bounds

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]

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
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    away = np.array(_SIDES[side])
    away = away / np.linalg.norm(away)
    return Viewpoint(eye=middle + away * 1.15 * max(size, 0.2), target=middle)


def parse_viewpoint(text: str, scene: Scene, messages: Messages) -> Viewpoint:
    """Return the viewpoint of `corner`, …, `X,Y,Z` or `X,Y,Z:X,Y,Z`: the eye, and what it sees.

    Raises WiringError for any other text.
    """
    if text in _SIDES:
        return whole_scene(scene, messages, text)
    eye, _, target = text.partition(":")
    looked_at = _point(target) if target else whole_scene(scene, messages).target
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


_NEAR_M = 0.02
_LIGHT = np.array((0.35, -0.45, 0.82))
_BACKGROUND = np.array((236, 239, 243), np.uint8)
_MOST_FRAGMENTS = 1_500_000
_FIELD_OF_VIEW = 0.9
"""Of the height [rad]."""


class _Triangles(NamedTuple):
    """Corners, shape (m, 3, 3), and colours, shape (m, 3)."""

    corners: Floats
    colors: Floats


class Painter:
    """Draws a scene again and again. size: (width, height) in pixels. smooth: edges are blended."""

    def __init__(self, scene: Scene, size: tuple[int, int], *, smooth: bool = False) -> None:
        self._scene = scene
        self._smooth = smooth
        self._width, self._height = (2 * size[0], 2 * size[1]) if smooth else size
        shown = (frame for frame in scene.frames if frame.visuals and not frame.is_ghost)
        self._bodies = {frame.name: _looks(frame) for frame in shown}

    def draw(self, messages: Messages, view: Viewpoint) -> Pixels:
        """Return a picture, shape (height, width, 3)."""
        width, height = self._width, self._height
        self._pixels = np.broadcast_to(_BACKGROUND, (height * width, 3)).copy()
        # 1 / distance of what is drawn [1/m].
        self._depth = np.zeros(height * width)
        poses = self._scene.world_poses(messages)
        placed = [_moved(body, poses[name]) for name, body in self._bodies.items()]
        if placed:
            self._paint(_Triangles(*map(np.concatenate, zip(*placed, strict=True))), view)
        pixels = self._pixels.reshape(height, width, 3)
        if not self._smooth:
            return pixels
        blocks = pixels.reshape(height // 2, 2, width // 2, 2, 3)
        blended: Pixels = blocks.mean(axis=(1, 3)).astype(np.uint8)
        return blended

    def _paint(self, triangles: _Triangles, view: Viewpoint) -> None:
        """Draw triangles in the world."""
        lit = _shaded(triangles)
        seen, colors = _clipped(_Triangles((lit.corners - view.eye) @ view.axes().T, lit.colors))
        focal = self._height / 2 / np.tan(_FIELD_OF_VIEW / 2)
        inverse = 1.0 / seen[:, :, 2]
        x = seen[:, :, 0] * inverse * focal + self._width / 2
        y = seen[:, :, 1] * inverse * focal + self._height / 2
        for rows in self._chunks(x, y):
            self._fill(x[rows], y[rows], inverse[rows], colors[rows])

    def _box(self, x: Floats, y: Floats) -> tuple[NDArray[np.int64], ...]:
        """Return the pixels that each triangle may touch: left, top, width, height."""
        left, top = (
            np.clip(np.floor(row.min(axis=1)), 0, most).astype(np.int64)
            for row, most in ((x, self._width), (y, self._height))
        )
        right, bottom = (
            np.clip(np.ceil(row.max(axis=1)) + 1, 0, most).astype(np.int64)
            for row, most in ((x, self._width), (y, self._height))
        )
        return left, top, np.maximum(right - left, 0), np.maximum(bottom - top, 0)

    def _chunks(self, x: Floats, y: Floats) -> list[NDArray[np.int64]]:
        """Return rows of triangles that have not too many fragments together."""
        _, _, width, height = self._box(x, y)
        rows = np.flatnonzero(width * height)
        total = np.cumsum((width * height)[rows])
        if not len(rows):
            return []
        ends = np.searchsorted(total, np.arange(_MOST_FRAGMENTS, total[-1], _MOST_FRAGMENTS))
        return [part for part in np.split(rows, ends) if len(part)]

    def _fill(self, x: Floats, y: Floats, inverse: Floats, colors: Floats) -> None:
        """Draw triangles where they are nearer than what is there."""
        left, top, width, height = self._box(x, y)
        counts = width * height
        owner = np.repeat(np.arange(len(counts)), counts)
        offset = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        px = left[owner] + offset % width[owner]
        py = top[owner] + offset // width[owner]
        area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
        scale = np.where(np.abs(area) > 1e-9, 1.0 / np.where(area == 0, 1.0, area), 0.0)
        shares = []
        for a, b in ((1, 2), (2, 0)):
            # The share of a corner is linear over the picture: one plane for each triangle.
            dx = (y[:, a] - y[:, b]) * scale
            dy = (x[:, b] - x[:, a]) * scale
            at = (x[:, a] * y[:, b] - x[:, b] * y[:, a]) * scale
            shares.append(dx[owner] * (px + 0.5) + dy[owner] * (py + 0.5) + at[owner])
        first, second = shares
        third = 1.0 - first - second
        inside = (first >= 0) & (second >= 0) & (third >= 0) & (scale != 0)[owner]
        owner, first, second, third = (row[inside] for row in (owner, first, second, third))
        place = (py * self._width + px)[inside]
        near = first * inverse[owner, 0] + second * inverse[owner, 1] + third * inverse[owner, 2]
        np.maximum.at(self._depth, place, near)
        front = near >= self._depth[place]
        self._pixels[place[front]] = colors[owner[front]].astype(np.uint8)


def _looks(frame: Frame) -> _Triangles:
    """Return what a frame looks like, in the frame."""
    corners, colors = [], []
    for visual in frame.visuals:
        shape = _Triangles(visual.mesh.vertices[visual.mesh.faces].astype(float), np.empty(0))
        corners.append(_moved(shape, visual.pose).corners)
        colors.append(np.broadcast_to(np.array(visual.shown_color, float), (len(corners[-1]), 3)))
    return _Triangles(np.concatenate(corners), np.concatenate(colors))


def _moved(triangles: _Triangles, pose: Pose) -> _Triangles:
    """Return triangles of a frame in its parent."""
    w, x, y, z = pose.wxyz
    turn = np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )
    return _Triangles(triangles.corners @ turn.T + np.array(pose.position), triangles.colors)


def _shaded(triangles: _Triangles) -> _Triangles:
    """Return triangles in a light from above, both of their sides alike."""
    corners, colors = triangles
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    light = np.abs(normal @ _LIGHT) / np.maximum(size, 1e-12)
    return _Triangles(corners, colors * (0.42 + 0.58 * light)[:, None])


def _clipped(triangles: _Triangles) -> _Triangles:
    """Return what is before the eye; triangles that cross its plane are cut there."""
    seen, colors = triangles
    behind = seen[:, :, 2] < _NEAR_M
    count = behind.sum(axis=1)
    kept, shades = [seen[count == 0]], [colors[count == 0]]
    for row in np.flatnonzero((count == 1) | (count == 2)):
        polygon = _cut(seen[row])
        for index in range(1, len(polygon) - 1):
            kept.append(np.stack((polygon[0], polygon[index], polygon[index + 1]))[None])
            shades.append(colors[row][None])
    return _Triangles(np.concatenate(kept), np.concatenate(shades))


def _cut(triangle: Floats) -> list[Floats]:
    pieces: list[Floats] = []
    for index in range(3):
        a, b = triangle[index - 1], triangle[index]
        if (a[2] < _NEAR_M) != (b[2] < _NEAR_M):
            pieces.append(a + (b - a) * (_NEAR_M - a[2]) / (b[2] - a[2]))
        if b[2] >= _NEAR_M:
            pieces.append(b)
    return pieces


def pixels_of(image: Image) -> Pixels:
    """Return an image in colours, shape (height, width, 3); a depth in grey, near is light.

    Raises ValueError where its bytes do not fit its size.
    """
    size = (image.height, image.width)
    if image.encoding == "rgb8":
        return np.frombuffer(image.data, np.uint8).reshape(*size, 3)
    meters = np.frombuffer(image.data, "<f4").reshape(size)
    far = float(np.max(meters, initial=0.0, where=np.isfinite(meters))) or 1.0
    near = np.clip(1 - np.nan_to_num(meters, nan=far, posinf=far) / far, 0, 1)
    return np.repeat((255 * near).astype(np.uint8)[:, :, None], 3, axis=2)


_STILL_SIZE = (480, 320)


def scene_still(recording: Recording) -> Pixels | None:
    """Return what a recording shows at its end, shape (320, 480, 3); None for nothing."""
    try:
        scene, history = build_scene(recording), History(recording)
    except (StepbusError, OSError, ValueError):
        return None
    if history.last_step < 0 or not scene.has_looks:
        return None
    messages = history.at(scene.topics, history.end_ns)
    painter = Painter(scene, _STILL_SIZE, smooth=True)
    return painter.draw(messages, whole_scene(scene, messages))
