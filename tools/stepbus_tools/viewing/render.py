"""Draws a scene into pixels: where it is seen from, and its triangles."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Image, StepbusError, WiringError
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.scene import Frame, Messages, Pose, Scene, bounds, build_scene

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
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        return None
    return np.array(numbers) if len(numbers) == 3 and all(map(math.isfinite, numbers)) else None


Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_NEAR_M = 0.02
_LIGHT = np.array((0.35, -0.45, 0.82))
_BACKGROUND = np.array((236, 239, 243), np.uint8)
_MOST_FRAGMENTS = 1_500_000
_FIELD_OF_VIEW = 0.9
"""Of the height [rad]."""


@dataclass(frozen=True, kw_only=True)
class _Body:
    """What one frame looks like, in the frame: vertices (n, 3), faces (m, 3), colours (m, 3)."""

    frame: str
    vertices: Floats
    faces: NDArray[np.int64]
    colors: Floats


@dataclass(frozen=True, kw_only=True)
class _Canvas:
    """A picture that is drawn: size (w, h), pixels (h·w, 3), depth (h·w): 1 / distance [1/m]."""

    size: tuple[int, int]
    pixels: Pixels
    depth: Floats


class Painter:
    """Draws a scene again and again. size: (width, height) in pixels."""

    def __init__(self, scene: Scene, size: tuple[int, int], *, smooth: bool = False) -> None:
        self._scene = scene
        self._smooth = smooth
        self._size = (2 * size[0], 2 * size[1]) if smooth else size
        self._bodies = [body for body in map(_body, scene.frames) if body is not None]

    def draw(self, messages: Messages, view: Viewpoint) -> Pixels:
        """Return a picture, shape (height, width, 3). smooth: edges are blended."""
        poses = self._scene.world_poses(messages)
        parts = [_placed(body, poses[body.frame]) for body in self._bodies]
        if not parts:
            width, height = self._size
            return np.broadcast_to(_BACKGROUND, (height, width, 3)).copy()
        corners = np.concatenate([part[0] for part in parts])
        colors = np.concatenate([part[1] for part in parts])
        pixels = self._paint(corners, colors, view)
        if not self._smooth:
            return pixels
        height, width, _ = pixels.shape
        blocks = pixels.reshape(height // 2, 2, width // 2, 2, 3)
        blended: Pixels = blocks.mean(axis=(1, 3)).astype(np.uint8)
        return blended

    def _paint(self, corners: Floats, colors: Floats, view: Viewpoint) -> Pixels:
        """Draw triangles. corners: shape (m, 3, 3) in the world. colors: shape (m, 3)."""
        width, height = self._size
        shaded = _shaded(corners, colors)
        seen = (corners - view.eye) @ view.axes().T
        seen, shaded = _clipped(seen, shaded)
        focal = height / 2 / np.tan(_FIELD_OF_VIEW / 2)
        inverse = 1.0 / seen[:, :, 2]
        x = seen[:, :, 0] * inverse * focal + width / 2
        y = seen[:, :, 1] * inverse * focal + height / 2
        canvas = _Canvas(
            size=self._size,
            pixels=np.broadcast_to(_BACKGROUND, (height * width, 3)).copy(),
            depth=np.zeros(height * width),
        )
        for rows in _chunks(x, y, self._size):
            _fill(canvas, x[rows], y[rows], inverse[rows], shaded[rows])
        return canvas.pixels.reshape(height, width, 3)


def _body(frame: Frame) -> _Body | None:
    """Return what a frame looks like; None where it has no looks, or is a ghost."""
    if not frame.visuals or frame.is_ghost:
        return None
    vertices, faces, colors, count = [], [], [], 0
    for visual in frame.visuals:
        mesh, pose = visual.mesh, visual.pose
        vertices.append(mesh.vertices.astype(float) @ _matrix(pose).T + np.array(pose.position))
        faces.append(mesh.faces.astype(np.int64) + count)
        shade: Floats = np.array(visual.shown_color, dtype=np.float64)
        colors.append(np.broadcast_to(shade, (len(mesh.faces), 3)))
        count += len(mesh.vertices)
    return _Body(
        frame=frame.name,
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        colors=np.concatenate(colors),
    )


def _placed(body: _Body, pose: Pose) -> tuple[Floats, Floats]:
    vertices = body.vertices @ _matrix(pose).T + np.array(pose.position)
    return vertices[body.faces], body.colors


def _matrix(pose: Pose) -> Floats:
    w, x, y, z = pose.wxyz
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )


def _shaded(corners: Floats, colors: Floats) -> Floats:
    """Return the colour of each triangle in a light from above, both of its sides alike."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    light = np.abs(normal @ _LIGHT) / np.maximum(size, 1e-12)
    lit: Floats = colors * (0.42 + 0.58 * light)[:, None]
    return lit


def _clipped(seen: Floats, colors: Floats) -> tuple[Floats, Floats]:
    """Return what is before the eye; triangles that cross its plane are cut there."""
    behind = seen[:, :, 2] < _NEAR_M
    count = behind.sum(axis=1)
    kept, shades = [seen[count == 0]], [colors[count == 0]]
    for row in np.flatnonzero((count == 1) | (count == 2)):
        polygon = _cut(seen[row])
        for index in range(1, len(polygon) - 1):
            kept.append(np.stack((polygon[0], polygon[index], polygon[index + 1]))[None])
            shades.append(colors[row][None])
    return np.concatenate(kept), np.concatenate(shades)


def _cut(triangle: Floats) -> list[Floats]:
    pieces: list[Floats] = []
    for index in range(3):
        a, b = triangle[index - 1], triangle[index]
        if (a[2] < _NEAR_M) != (b[2] < _NEAR_M):
            pieces.append(a + (b - a) * (_NEAR_M - a[2]) / (b[2] - a[2]))
        if b[2] >= _NEAR_M:
            pieces.append(b)
    return pieces


def _box(x: Floats, y: Floats, size: tuple[int, int]) -> tuple[NDArray[np.int64], ...]:
    """Return the pixels that each triangle may touch: left, top, width, height."""
    left = np.clip(np.floor(x.min(axis=1)), 0, size[0]).astype(np.int64)
    right = np.clip(np.ceil(x.max(axis=1)) + 1, 0, size[0]).astype(np.int64)
    top = np.clip(np.floor(y.min(axis=1)), 0, size[1]).astype(np.int64)
    bottom = np.clip(np.ceil(y.max(axis=1)) + 1, 0, size[1]).astype(np.int64)
    return left, top, np.maximum(right - left, 0), np.maximum(bottom - top, 0)


def _chunks(x: Floats, y: Floats, size: tuple[int, int]) -> list[NDArray[np.int64]]:
    """Return rows of triangles that have not too many fragments together."""
    _, _, width, height = _box(x, y, size)
    rows = np.flatnonzero(width * height)
    total = np.cumsum((width * height)[rows])
    if not len(rows):
        return []
    ends = np.searchsorted(total, np.arange(_MOST_FRAGMENTS, total[-1], _MOST_FRAGMENTS))
    return [part for part in np.split(rows, ends) if len(part)]


def _fill(canvas: _Canvas, x: Floats, y: Floats, inverse: Floats, colors: Floats) -> None:
    """Draw triangles where they are nearer than what is there."""
    left, top, width, height = _box(x, y, canvas.size)
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
    place = (py * canvas.size[0] + px)[inside]
    near = first * inverse[owner, 0] + second * inverse[owner, 1] + third * inverse[owner, 2]
    np.maximum.at(canvas.depth, place, near)
    front = near >= canvas.depth[place]
    canvas.pixels[place[front]] = colors[owner[front]].astype(np.uint8)


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
