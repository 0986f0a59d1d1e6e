"""Horizontal faces in a depth image, with their edges."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stepbus_kinematics import Indices, Vector
from stepbus_store.perception.images import View

Mask = NDArray[np.bool_]
_SLOPE = 0.3
"""Slope up to which a surface counts as horizontal."""
LEVELS_APART = 3e-3
"""Largest difference in height within a face [m]."""
_HIGHER = 0.02
"""By so much higher than a point, what the camera sees before it hides it [m]."""
_FEWEST_PIXELS = 12
_NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))


@dataclass(frozen=True, kw_only=True)
class Patch:
    """The visible part of a horizontal face.

    height: in the frame of the scene [m]. points: of its pixels, shape (n, 2); edge: points of its
    true edge, not of an occlusion, shape (k, 2), x and y [m]. area: visible [m²].
    """

    height: float
    points: Vector
    edge: Vector
    area: float


class Scene:
    """The points of a view in a frame with z up.

    camera: pose of the optical frame in that frame, a `pinocchio.SE3`.
    """

    def __init__(self, view: View, camera: Any) -> None:
        self._view = view
        self._camera = camera
        self._pixel_rays = _pixel_rays(view.depth.shape, view.focal, view.centre)
        self._known = np.isfinite(view.depth) & (view.depth > 0)
        depth = np.where(self._known, view.depth, np.inf)
        rays_z = self._pixel_rays @ camera.rotation[2]
        with np.errstate(invalid="ignore", divide="ignore"):
            height = camera.translation[2] + depth * rays_z
            self._height: Vector = np.where(self._known, height, -np.inf)
            self._pixel_area = view.depth**2 / (view.focal[0] * view.focal[1] * np.abs(rays_z))
        self.flat = self._known & self._horizontal()
        """Pixels of horizontal surfaces, shape (h, w)."""

    def probe(self, points: Vector, among: Mask) -> tuple[Vector, Mask, Mask]:
        """Return the visible points in the direction of given points, shape (n, 3) [m].

        That is: the visible points, shape (n, 3); whether there is one; whether it is within a
        mask, shape (h, w).
        """
        u, v, inside = self._pixels(points)
        inside &= self._known[v, u]
        seen = self._seen(v, u, inside)
        return seen, inside, inside & among[v, u]

    def _seen(self, rows: Any, columns: Any, known: Mask) -> Vector:
        """Return the points that pixels show, shape (..., 3) [m]; of unknown depth: the camera."""
        reach = np.where(known, self._view.depth[rows, columns], 0.0)[..., None]
        rays = self._pixel_rays[rows, columns]
        seen: Vector = self._camera.translation + (rays * reach) @ self._camera.rotation.T
        return seen

    def points(self, among: Mask) -> tuple[Indices, Indices, Vector]:
        """Return rows, columns and points, shape (n, 3) [m], of the pixels within a mask."""
        rows, columns = np.nonzero(self._known & among)
        return rows, columns, self._seen(rows, columns, self._known[rows, columns])

    @cached_property
    def _all_points(self) -> tuple[Vector, Vector, Vector]:
        """x, y and z of each pixel, shape (h, w) each [m]; of unknown depth: anything."""
        seen = self._seen(slice(None), slice(None), self._known)
        x, y, z = np.ascontiguousarray(np.moveaxis(seen, 2, 0))
        return x, y, z

    def flat_near(self, among: Mask, place: tuple[float, ...], within: float) -> Vector:
        """Return the points, shape (n, 3) [m], of flat pixels in a mask in a square around a place.

        within: half its side [m].
        """
        x, y, z = self._all_points
        is_near = (np.abs(x - place[0]) < within) & (np.abs(y - place[1]) < within)
        chosen = is_near & among & self.flat
        return np.stack([x[chosen], y[chosen], z[chosen]], axis=1)

    def hidden(self, points: Vector) -> float:
        """Return the share of points, shape (n, 3) [m], that higher things hide, 0 to 1.

        A pixel without depth hides as well: something is too near. Points beyond the image do not
        count.
        """
        u, v, inside = self._pixels(points)
        known = inside & self._known[v, u]
        height = self._seen(v, u, known)[:, 2]
        hides = inside & (~known | (height > points[:, 2] + _HIGHER))
        return float(hides.sum() / max(inside.sum(), 1))

    def _pixels(self, points: Vector) -> tuple[Indices, Indices, Mask]:
        """Return column and row of points, shape (n, 3) [m], and which are within the image."""
        view, camera = self._view, self._camera
        local = (points - camera.translation) @ camera.rotation
        ahead = local[:, 2] > 0
        scale = view.focal / np.where(ahead, local[:, 2], 1.0)[:, None]
        u, v = np.rint(local[:, :2] * scale + view.centre).astype(np.intp).T
        rows, columns = view.depth.shape
        inside = ahead & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        return np.where(inside, u, 0), np.where(inside, v, 0), inside

    def _horizontal(self) -> Mask:
        """Return where the height changes little to a neighbour in the row and in the column."""
        limit = _SLOPE * self._view.depth / max(self._view.focal)
        flat = np.ones(limit.shape, dtype=bool)
        for axis in (0, 1):
            with np.errstate(invalid="ignore"):
                rise = np.abs(np.diff(self._height, axis=axis))
            rise[np.isnan(rise)] = np.inf
            before = [(1, 0) if a == axis else (0, 0) for a in (0, 1)]
            after = [(0, 1) if a == axis else (0, 0) for a in (0, 1)]
            wide = (np.pad(rise, side, constant_values=np.inf) for side in (before, after))
            flat &= np.minimum(*wide) < limit
        return flat

    def patches(self, among: Mask) -> Iterator[Patch]:
        """Yield the horizontal faces within a mask, shape (h, w)."""
        flat = self.flat & among
        for low, high in _levels(self._height[flat]):
            level = flat & (self._height >= low) & (self._height <= high)
            _, labels, boxes, _ = cv2.connectedComponentsWithStats(
                level.astype(np.uint8), connectivity=4
            )
            for number, (left, top, width, height, pixels) in enumerate(boxes.tolist()):
                if number and pixels >= _FEWEST_PIXELS:
                    inside = labels[top : top + height, left : left + width] == number
                    rows, columns = np.nonzero(inside)
                    own = labels == number
                    yield self._patch(own, among & ~own, rows + top, columns + left)

    def _patch(self, own: Mask, alike: Mask, rows: Indices, columns: Indices) -> Patch:
        """Return a patch; own: its pixels; alike: others of its colour."""
        height = float(np.median(self._height[rows, columns]))
        return Patch(
            height=height,
            points=self._on_plane(columns, rows, height),
            edge=self._edge(own, alike, rows, columns, height),
            area=float(self._pixel_area[rows, columns].sum()),
        )

    def _edge(
        self, own: Mask, alike: Mask, rows: Indices, columns: Indices, height: float
    ) -> Vector:
        """Return the points half-way between a pixel of the face and one beyond its edge.

        The face may continue below an object that is higher, and beyond the image. A neighbour of
        the same colour that is only slightly higher is the foot of an object on the face.
        """
        end = ~own & (self._height < np.where(alike, height, height + LEVELS_APART))
        edges = []
        for down, right in _NEIGHBOURS:
            r, c = rows + down, columns + right
            inside = (r >= 0) & (r < own.shape[0]) & (c >= 0) & (c < own.shape[1])
            r, c = np.where(inside, r, 0), np.where(inside, c, 0)
            ends = inside & end[r, c]
            u, v = columns[ends] + right / 2, rows[ends] + down / 2
            edges.append(self._on_plane(u, v, height))
        return np.concatenate(edges)

    def _on_plane(self, u: NDArray[np.generic], v: NDArray[np.generic], height: float) -> Vector:
        """Return x, y, shape (n, 2) [m], where the rays of pixels reach a height."""
        rays = _rays(u, v, self._view.focal, self._view.centre) @ self._camera.rotation.T
        reach = (height - self._camera.translation[2]) / rays[:, 2]
        points: Vector = self._camera.translation[:2] + rays[:, :2] * reach[:, None]
        return points


def _rays(
    u: NDArray[np.generic],
    v: NDArray[np.generic],
    focal: tuple[float, float],
    centre: tuple[float, float],
) -> Vector:
    """Return the directions of pixels in the optical frame, with z = 1."""
    rays = np.ones((*u.shape, 3))
    rays[..., 0] = (np.asarray(u, dtype=np.float64) - centre[0]) / focal[0]
    rays[..., 1] = (np.asarray(v, dtype=np.float64) - centre[1]) / focal[1]
    return rays


@lru_cache(maxsize=8)
def _pixel_rays(
    shape: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float]
) -> Vector:
    """Return the directions of all pixels of a camera, shape (h, w, 3); it is always the same."""
    v, u = np.meshgrid(*map(np.arange, shape), indexing="ij")
    rays = _rays(u, v, focal, centre)
    rays.flags.writeable = False
    return rays


def _levels(heights: Vector) -> list[tuple[float, float]]:
    """Return the lowest and highest of each group of heights, separated by gaps."""
    if not heights.size:
        return []
    ordered = np.sort(heights)
    cuts = np.flatnonzero(np.diff(ordered) > LEVELS_APART)
    starts, ends = [0, *(cuts + 1)], [*cuts, len(ordered) - 1]
    return [(float(ordered[a]), float(ordered[b])) for a, b in zip(starts, ends, strict=True)]
