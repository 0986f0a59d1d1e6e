"""Draws a scene into pixels, triangle by triangle."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Image
from stepbus_tools.theme import PAPER
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Messages, Scene
from stepbus_tools.viewing.viewpoint import FIELD_OF_VIEW, Floats, Viewpoint, moved, rotation

Pixels = NDArray[np.uint8]


def rgb(color: str) -> tuple[int, int, int]:
    """Return red, green and blue of a colour such as `#1b2430`."""
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue


_LINE = 0.0015
"""Half of a line's width on the floor, of its length."""
_NEAR_M = 0.02
_LIGHT = np.array((0.35, -0.45, 0.82))
_BACKGROUND = np.array(rgb(PAPER["raised"]), np.uint8)
_MOST_FRAGMENTS = 1_500_000


class _Triangles(NamedTuple):
    """Corners, shape (m, 3, 3), and colours, shape (m, 3)."""

    corners: Floats
    colors: Floats


class _Body(NamedTuple):
    """What a frame looks like, in the frame.

    vertices: shape (n, 3) [m]. faces: shape (m, 3). normals: of length 1, shape (m, 3). colors:
    shape (m, 3).
    """

    vertices: Floats
    faces: NDArray[np.int64]
    normals: Floats
    colors: Floats


class Painter:
    """Draws a scene again and again. size: (width, height) in pixels. smooth: edges are blended.

    floor: draws a grid below a box, of its lower and its upper corner. What has not moved since the
    first picture is drawn once for all of them.
    """

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int],
        *,
        smooth: bool = False,
        floor: tuple[Floats, Floats] | None = None,
    ) -> None:
        self._scene = scene
        self._smooth = smooth
        self._width, self._height = (2 * size[0], 2 * size[1]) if smooth else size
        shown = (frame for frame in scene.frames if frame.visuals and not frame.is_ghost)
        self._bodies = {frame.name: _body(frame) for frame in shown}
        self._floor = None if floor is None else _grid(*floor)
        self._view: Viewpoint | None = None
        self._first: dict[str, Pose] = {}
        self._moving: set[str] = set()
        self._still: tuple[Pixels, NDArray[np.float32]]

    def draw(self, messages: Messages, view: Viewpoint) -> Pixels:
        """Return a picture, shape (height, width, 3)."""
        poses = self._scene.world_poses(messages)
        if view is not self._view:
            self._view, self._first, self._moving = view, poses, set()
            self._paint_still()
        moved = {name for name in self._bodies if poses[name] != self._first[name]}
        if not moved <= self._moving:
            self._moving |= moved
            self._paint_still()
        pixels, depth = self._still
        self._pixels, self._depth = pixels.copy(), depth.copy()
        self._paint(self._moving, poses)
        drawn = self._pixels.reshape(self._height, self._width, 3)
        return _halved(drawn) if self._smooth else drawn

    def cut_out(self, messages: Messages, view: Viewpoint) -> Pixels:
        """Return a picture without a background, shape (height, width, 4)."""
        pixels = self.draw(messages, view)
        drawn = np.where(self._depth > 0, 255, 0).astype(np.uint8)
        drawn = drawn.reshape(self._height, self._width, 1)
        cover = _halved(drawn) if self._smooth else drawn
        share = np.maximum(cover, 1) / 255
        # An edge is blended with the background, which is another one behind the picture.
        own = np.clip((pixels - _BACKGROUND * (1 - share)) / share, 0, 255)
        return np.concatenate((np.where(cover, own, 0).astype(np.uint8), cover), axis=2)

    def _paint_still(self) -> None:
        """Draw all that has not moved yet."""
        count = self._height * self._width
        # Beside the pixels, 1 / distance of what is drawn [1/m].
        self._pixels = np.broadcast_to(_BACKGROUND, (count, 3)).copy()
        self._depth = np.zeros(count, np.float32)
        if self._floor is not None:
            self._paint_all([self._seen(self._floor, Pose())])
        self._paint(self._bodies.keys() - self._moving, self._first)
        self._still = self._pixels, self._depth

    def _paint(self, names: Collection[str], poses: Mapping[str, Pose]) -> None:
        """Draw some bodies."""
        bodies = self._bodies.items()
        placed = [self._seen(body, poses[name]) for name, body in bodies if name in names]
        if placed:
            self._paint_all(placed)

    def _paint_all(self, placed: Sequence[_Triangles]) -> None:
        """Draw triangles: x, y [pixels] and 1 / distance [1/m] of their corners."""
        corners, colors = (np.concatenate(rows) for rows in zip(*placed, strict=True))
        box = self._box(corners)
        for rows in _chunks(box):
            self._fill(box[:, rows], corners[rows], colors[rows])

    def _seen(self, body: _Body, pose: Pose) -> _Triangles:
        """Return the triangles of a body in the picture, in a light from above.

        Both sides of a triangle are lit alike.
        """
        assert self._view is not None  # noqa: S101  (draw has set it)
        axes, turn = self._view.axes(), rotation(pose)
        vertices = body.vertices @ (axes @ turn).T + axes @ (pose.position - self._view.eye)
        light = np.abs(body.normals @ (turn.T @ _LIGHT))
        colors = body.colors * (0.42 + 0.58 * light)[:, None]
        if vertices[:, 2].min() >= _NEAR_M:
            return _Triangles(self._projected(vertices)[body.faces], colors)
        corners, colors = _clipped(_Triangles(vertices[body.faces], colors))
        return _Triangles(self._projected(corners), colors)

    def _projected(self, points: Floats) -> Floats:
        """Return x, y [pixels] and 1 / distance [1/m] of points before the eye."""
        focal = self._height / 2 / np.tan(FIELD_OF_VIEW / 2)
        inverse = 1.0 / points[..., 2]
        x = points[..., 0] * inverse * focal + self._width / 2
        y = points[..., 1] * inverse * focal + self._height / 2
        return np.stack((x, y, inverse), axis=-1)

    def _box(self, corners: Floats) -> NDArray[np.int32]:
        """Return the pixels whose middle a triangle may cover: left, top, width, height."""
        a, b, c = (corners[:, number, :2] for number in range(3))
        most = self._width, self._height
        low = np.ceil(np.minimum(np.minimum(a, b), c) - 0.5)
        high = np.floor(np.maximum(np.maximum(a, b), c) + 0.5)
        start, end = (np.clip(edge, 0, most).astype(np.int32) for edge in (low, high))
        return np.concatenate((start, np.maximum(end - start, 0)), axis=1).T

    def _fill(self, box: NDArray[np.int32], corners: Floats, colors: Floats) -> None:
        """Draw triangles where they are nearer than what is there."""
        left, top, width, height = box
        counts = width * height
        owner = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        first = np.cumsum(counts) - counts
        offset = np.arange(len(owner), dtype=np.int32) - np.repeat(first.astype(np.int32), counts)
        down = offset // width[owner]
        right = offset - down * width[owner]
        x, y, inverse = (corners[:, :, number] for number in range(3))
        area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
        scale = np.where(np.abs(area) > 1e-9, 1.0 / np.where(area == 0, 1.0, area), np.nan)
        planes = []
        for a, b in ((1, 2), (2, 0), (0, 1)):
            # The share of a corner is linear over the picture: one plane for each triangle, from
            # the middle of the first pixel of its box.
            dx = (y[:, a] - y[:, b]) * scale
            dy = (x[:, b] - x[:, a]) * scale
            at = (x[:, a] * y[:, b] - x[:, b] * y[:, a]) * scale
            planes.append(np.stack((at + dx * (left + 0.5) + dy * (top + 0.5), dx, dy)))
        nearness = sum(plane * inverse[:, number] for number, plane in enumerate(planes))
        # Single precision does from here on, and is twice as fast.
        at, dx, dy = np.asarray(planes, np.float32).transpose(1, 0, 2)
        u, v = right.astype(np.float32), down.astype(np.float32)
        inside = np.ones(len(owner), bool)
        for number in range(3):
            inside &= dx[number][owner] * u + dy[number][owner] * v + at[number][owner] >= 0
        owner, right, down, u, v = (row[inside] for row in (owner, right, down, u, v))
        at, dx, dy = np.asarray(nearness, np.float32)
        near = dx[owner] * u + dy[owner] * v + at[owner]
        place = (top[owner] + down) * self._width + left[owner] + right
        np.maximum.at(self._depth, place, near)
        front = near >= self._depth[place]
        self._pixels[place[front]] = colors.astype(np.uint8)[owner[front]]


def _halved(pixels: Pixels) -> Pixels:
    """Return a picture of half the size, of the means of four pixels each."""
    rows = pixels[0::2].astype(np.uint16) + pixels[1::2]
    blended: Pixels = ((rows[:, 0::2] + rows[:, 1::2]) >> 2).astype(np.uint8)
    return blended


def _chunks(box: NDArray[np.int32]) -> list[NDArray[np.int64]]:
    """Return rows of triangles that have not too many fragments together."""
    counts = box[2].astype(np.int64) * box[3]
    rows = np.flatnonzero(counts)
    if not len(rows):
        return []
    total = np.cumsum(counts[rows])
    ends = np.searchsorted(total, np.arange(_MOST_FRAGMENTS, total[-1], _MOST_FRAGMENTS))
    return [part for part in np.split(rows, ends) if len(part)]


def _body(frame: Frame) -> _Body:
    """Return what a frame looks like, in the frame."""
    vertices, faces, colors, count = [], [], [], 0
    for visual in frame.visuals:
        mesh = visual.mesh
        vertices.append(moved(mesh.vertices.astype(float), visual.pose))
        faces.append(mesh.faces.astype(np.int64) + count)
        colors.append(np.broadcast_to(np.array(visual.shown_color, float), mesh.faces.shape))
        count += len(mesh.vertices)
    points, rows = np.concatenate(vertices), np.concatenate(faces)
    a, b, c = (points[rows[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    size = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return _Body(points, rows, normals / size, np.concatenate(colors))


def _grid(low: Floats, high: Floats) -> _Body:
    """Return lines on the floor, in cells of 1, 2 or 5 times a power of ten [m]."""
    reach = 0.75 * float((high - low).max())
    decade = 10.0 ** math.floor(math.log10(max(reach, 0.01) / 6))
    cell = decade * next(times for times in (1, 2, 5, 10) if reach <= 6 * decade * times)
    count = math.ceil(reach / cell)
    middle = np.round((low + high) / 2 / cell) * cell
    # A hair lower: what lies on the floor hides its lines.
    middle[2] = min(0.0, float(low[2])) - 1e-3 * reach
    lines, half = np.arange(-count, count + 1) * cell, reach * _LINE
    strips = [
        [(x, y, 0.0) for x in (at - half, at + half) for y in (lines[0], lines[-1])] for at in lines
    ]
    along = np.array(strips).reshape(-1, 3)
    points = np.concatenate((along, along[:, (1, 0, 2)])) + middle
    first = np.arange(0, len(points), 4)[:, None]
    faces = (first + np.array([[0, 1, 2, 1, 2, 3]])).reshape(-1, 3)
    upwards = np.broadcast_to((0.0, 0.0, 1.0), faces.shape)
    colors = np.broadcast_to(np.array(rgb(PAPER["line"]), float), faces.shape)
    return _Body(points, faces, upwards, colors)


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
