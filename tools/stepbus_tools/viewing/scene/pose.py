"""Poses: positions and rotations."""

import math
from collections.abc import Sequence
from typing import NamedTuple

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
