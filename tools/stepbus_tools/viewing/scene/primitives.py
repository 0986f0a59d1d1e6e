"""Poses, and the meshes of boxes, spheres and cylinders."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Wxyz = tuple[float, float, float, float]


class Pose(NamedTuple):
    """A pose in the parent frame. position: x, y, z [m]. wxyz: unit quaternion."""

    position: Vector = (0.0, 0.0, 0.0)
    wxyz: Wxyz = (1.0, 0.0, 0.0, 0.0)

    def __matmul__(self, other: "Pose") -> "Pose":
        """Return the pose, in the parent frame of this one, of what `other` is in this frame."""
        x, y, z = rotated(self.wxyz, other.position)
        px, py, pz = self.position
        return Pose((px + x, py + y, pz + z), product(self.wxyz, other.wxyz))

    def inverse(self) -> "Pose":
        """Return the pose of the parent frame in this one."""
        w, x, y, z = self.wxyz
        back = (w, -x, -y, -z)
        px, py, pz = rotated(back, self.position)
        return Pose((-px, -py, -pz), back)


def product(a: Wxyz, b: Wxyz) -> Wxyz:
    """Return the rotation b followed by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def rotated(q: Wxyz, v: Vector) -> Vector:
    """Return a vector that a rotation has turned."""
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def about(axis: Vector, angle: float) -> Wxyz:
    """Return the rotation about a unit vector. angle: [rad]."""
    s = math.sin(angle / 2)
    return (math.cos(angle / 2), axis[0] * s, axis[1] * s, axis[2] * s)


def from_rpy(rpy: Sequence[float]) -> Wxyz:
    """Return the rotation of roll, pitch, yaw about fixed axes [rad]."""
    roll, pitch, yaw = rpy
    turned = product(about((0.0, 1.0, 0.0), pitch), about((1.0, 0.0, 0.0), roll))
    return product(about((0.0, 0.0, 1.0), yaw), turned)


def from_xyzw(position: Sequence[float], xyzw: Sequence[float]) -> Pose:
    """Return a pose as messages have it: the real part last."""
    px, py, pz = position
    x, y, z, w = xyzw
    return Pose((px, py, pz), (w, x, y, z))


def unit(v: Sequence[float]) -> Vector:
    """Return a vector with length 1; z where it has none."""
    x, y, z = v
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 1.0)


Triangles = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices, shape (n, 3) [m], and faces, shape (m, 3), counter-clockwise from outside."""

_SEGMENTS = 24
_RINGS = 12


def _box(size: Sequence[float]) -> Triangles:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(a, *pair) for a, b, c, d in sides for pair in ((b, c), (c, d))]
    return (signs * np.array(size) / 2).astype(np.float32), np.array(faces, np.uint32)


def _turned(profile: Sequence[tuple[float, float]]) -> Triangles:
    """Return what a line turns into about z. profile: radius and height, from below [m]."""
    angles = np.arange(_SEGMENTS) * (2 * np.pi / _SEGMENTS)
    rows = [(r * np.cos(angles), r * np.sin(angles), np.full(_SEGMENTS, z)) for r, z in profile]
    vertices = np.concatenate([np.stack(row, axis=1) for row in rows])
    here = np.arange(_SEGMENTS)
    then = (here + 1) % _SEGMENTS
    faces = []
    for ring, ((below, _), (above, _)) in enumerate(pairwise(profile)):
        a, b = ring * _SEGMENTS, (ring + 1) * _SEGMENTS
        if below:
            faces.append(np.stack((a + here, a + then, b + then), axis=1))
        if above:
            faces.append(np.stack((a + here, b + then, b + here), axis=1))
    return vertices.astype(np.float32), np.concatenate(faces).astype(np.uint32)


def _cylinder(size: Sequence[float]) -> Triangles:
    radius, half = size[0], size[1] / 2
    return _turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def _capsule(size: Sequence[float]) -> Triangles:
    radius, half = size[0], size[1] / 2
    angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 2)
    rows = [(radius * np.cos(a), radius * np.sin(a) + np.copysign(half, a)) for a in angles]
    rows[0], rows[-1] = (0.0, rows[0][1]), (0.0, rows[-1][1])
    return _turned([(float(r), float(z)) for r, z in rows])


def _sphere(size: Sequence[float]) -> Triangles:
    return _capsule((size[0], 0.0))


PRIMITIVES: Mapping[str, Callable[[Sequence[float]], Triangles]] = {
    "box": _box,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "sphere": _sphere,
}
"""Shape → what makes it of its sizes: x, y, z; radius, length; radius [m]."""
