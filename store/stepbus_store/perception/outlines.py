"""Outlines of known size, fitted to edge points by least squares."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from stepbus_kinematics import Vector

_ROUNDS = 20
_STEP = 1e-6
"""Steps shorter than this end the fit [m, rad]."""
_DAMPING = 1e-6
_FAR = 3.0
"""Edge points farther from the outline than this multiple of the median are outliers."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """The pose of an outline.

    centre: x, y [m]. yaw: [rad]; 0 for a disc. rms: distance of the edge points from it [m].
    """

    centre: tuple[float, float]
    yaw: float
    rms: float


@dataclass(frozen=True)
class Disc:
    """The top of a cylinder; radius [m].

    area: [m²]. reach: largest distance of its edge from its centre [m]. guess: an initial x, y, yaw
    from points of the face, shape (n, 2) [m]. residuals: how far edge points, shape (k, 2) [m], are
    outside, shape (k,), and the Jacobian by x, y, yaw, shape (k, 3). canonical: the smallest yaw
    with the same outline [rad].
    """

    radius: float

    @property
    def area(self) -> float:
        """Return what it encloses [m²]."""
        return math.pi * self.radius**2

    @property
    def reach(self) -> float:
        """Return the radius [m]."""
        return self.radius

    def guess(self, points: Vector) -> Vector:
        """Return the mean of the points."""
        return np.array([*points.mean(axis=0), 0.0])

    def residuals(self, at: Vector, edge: Vector) -> tuple[Vector, Vector]:
        """Return |e - c| - r and its Jacobian; the yaw has no effect."""
        away = edge - at[:2]
        distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)
        slopes = np.column_stack([-away / distance[:, None], np.zeros(len(edge))])
        return distance - self.radius, slopes

    def canonical(self, yaw: float) -> float:
        """Return 0."""
        return 0.0


@dataclass(frozen=True)
class Rectangle:
    """The top of a box; lengths along x and y [m]. Otherwise as `Disc`."""

    length_x: float
    length_y: float

    @property
    def area(self) -> float:
        """Return what it encloses [m²]."""
        return self.length_x * self.length_y

    @property
    def reach(self) -> float:
        """Return half the diagonal [m]."""
        return math.hypot(self.length_x, self.length_y) / 2

    def guess(self, points: Vector) -> Vector:
        """Return the smallest rectangle around the points, with matching long sides."""
        (x, y), (width, height), degrees = cv2.minAreaRect((points * 1e3).astype(np.float32))
        yaw = math.radians(degrees)
        if (width >= height) != (self.length_x >= self.length_y):
            yaw += math.pi / 2
        return np.array([x * 1e-3, y * 1e-3, self.canonical(yaw)])

    def residuals(self, at: Vector, edge: Vector) -> tuple[Vector, Vector]:
        """Return the distance from the line of the nearest side, and its Jacobian."""
        c, s = math.cos(at[2]), math.sin(at[2])
        local = (edge - at[:2]) @ np.array([[c, -s], [s, c]])
        beyond = np.abs(local) - [self.length_x / 2, self.length_y / 2]
        on_x = beyond[:, 0] >= beyond[:, 1]
        sign = np.where(on_x, np.sign(local[:, 0]), np.sign(local[:, 1]))
        normal = np.where(on_x[:, None], [c, s], [-s, c])
        turn = np.where(on_x, local[:, 1], -local[:, 0])
        slopes = np.column_stack([-normal * sign[:, None], turn * sign])
        return beyond.max(axis=1), slopes

    def canonical(self, yaw: float) -> float:
        """Return the yaw within ±45° for a square, within ±90° for a rectangle."""
        same = math.pi / 2 if math.isclose(self.length_x, self.length_y) else math.pi
        return yaw - same * round(yaw / same)


Outline = Disc | Rectangle
"""The edge of a face."""


def fit(outline: Outline, points: Vector, edge: Vector) -> Fit:
    """Return the best pose of an outline.

    points: of the face, shape (n, 2); edge: of its edge, shape (k, 2) [m]. Gauss-Newton minimises
    the signed distances of the edge points; a second fit leaves out the outliers. What the edge
    does not determine stays at the initial guess.
    """
    at = _solve(outline, outline.guess(points), edge)
    off = np.abs(outline.residuals(at, edge)[0])
    near = off <= max(_FAR * np.median(off), 1e-3)
    at = _solve(outline, at, edge[near])
    off = outline.residuals(at, edge)[0]
    return Fit(
        centre=(float(at[0]), float(at[1])),
        yaw=outline.canonical(float(at[2])),
        rms=float(np.sqrt(np.mean(off**2))),
    )


def _solve(outline: Outline, at: Vector, edge: Vector) -> Vector:
    damping = _DAMPING * len(edge) * np.diag([1.0, 1.0, outline.area])
    for _ in range(_ROUNDS):
        off, slopes = outline.residuals(at, edge)
        step = np.linalg.solve(slopes.T @ slopes + damping, -slopes.T @ off)
        at = at + step
        if np.abs(step).max() < _STEP:
            break
    return at
