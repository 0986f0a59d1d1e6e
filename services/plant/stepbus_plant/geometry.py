"""Poses and what is computed with them, and OpenGL's matrices for a picture."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Point, Quaternion

Array = NDArray[np.float64]
Pose = tuple[Point, Quaternion]
"""Position [m], and orientation as x, y, z, w."""
_NO_TURN = (0.0, 0.0, 0.0, 1.0)
_PARALLEL = 1.0 - 1e-12
"""Cosine of half the angle between orientations that are as good as the same."""


class Geometry:
    """Poses in double precision. An engine that computes otherwise has a geometry of its own."""

    def compose(self, one: Pose, other: Pose) -> Pose:
        """Return the pose that `other` is in the frame that `one` is given in."""
        (x, y, z), turn = one
        a, b, c = self.turned(turn, other[0])
        return (x + a, y + b, z + c), product(turn, other[1])

    def inverse(self, pose: Pose) -> Pose:
        """Return the pose of the frame that a pose is given in, in the frame of the pose."""
        back = _conjugate(pose[1])
        x, y, z = self.turned(back, pose[0])
        return (-x, -y, -z), back

    def turned(self, orientation: Quaternion, direction: Point) -> Point:
        """Return a direction of a frame in the world."""
        x, y, z, w = orientation
        u, v, t = direction
        a, b, c = 2 * (y * t - z * v), 2 * (z * u - x * t), 2 * (x * v - y * u)
        return (u + w * a + y * c - z * b, v + w * b + z * a - x * c, t + w * c + x * b - y * a)

    def between(self, one: Pose, other: Pose, share: float) -> Pose:
        """Return the pose at a share of the way from one to another, turned evenly."""
        x, y, z = (a + share * (b - a) for a, b in zip(one[0], other[0], strict=True))
        return (x, y, z), _slerp(one[1], other[1], share)

    def spin_between(self, one: Quaternion, other: Quaternion, seconds: float) -> Point:
        """Return the angular velocity that turns one orientation into another so fast [rad/s]."""
        x, y, z, w = product(other, _conjugate(one))
        sine = math.sqrt(x * x + y * y + z * z)
        angle = math.remainder(2.0 * math.atan2(sine, w), 2 * math.pi)
        rate = angle / (sine * seconds) if sine else 0.0
        return x * rate, y * rate, z * rate

    def out_of(self, frame: Pose, point: Point) -> Point:
        """Return a point of a frame in the world."""
        return self.compose(frame, (point, _NO_TURN))[0]

    def into(self, frame: Pose, point: Point) -> Point:
        """Return a point of the world in a frame."""
        return self.out_of(self.inverse(frame), point)


def _slerp(one: Quaternion, other: Quaternion, share: float) -> Quaternion:
    cosine = sum(a * b for a, b in zip(one, other, strict=True))
    sign, cosine = math.copysign(1.0, cosine), abs(cosine)
    if cosine > _PARALLEL:
        return one
    angle = math.acos(cosine)
    mine = math.sin((1.0 - share) * angle) / math.sin(angle)
    others = sign * math.sin(share * angle) / math.sin(angle)
    x, y, z, w = (mine * a + others * b for a, b in zip(one, other, strict=True))
    return x, y, z, w


def product(one: Quaternion, other: Quaternion) -> Quaternion:
    """Return the orientation `other` of the frame `one`, in the frame that that is given in."""
    a, b, c, d = one
    x, y, z, w = other
    return (
        d * x + a * w + b * z - c * y,
        d * y + b * w + c * x - a * z,
        d * z + c * w + a * y - b * x,
        d * w - a * x - b * y - c * z,
    )


def quaternion(rpy: Iterable[float]) -> Quaternion:
    """Return the quaternion of roll, pitch, yaw about fixed axes [rad]; PyBullet's, to the bit."""
    roll, pitch, yaw = (angle / 2.0 for angle in rpy)
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    sy, cy = math.sin(yaw), math.cos(yaw)
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    w = cr * cp * cy + sr * sp * sy
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


def rotation(orientation: Sequence[float]) -> Array:
    """Return the matrix of a quaternion, shape (3, 3); PyBullet's, to the bit."""
    x, y, z, w = orientation
    s = 2.0 / (x * x + y * y + z * z + w * w)
    xs, ys, zs = x * s, y * s, z * s
    wx, wy, wz = w * xs, w * ys, w * zs
    xx, xy, xz = x * xs, x * ys, x * zs
    yy, yz, zz = y * ys, y * zs, z * zs
    return np.array(
        [
            [1.0 - (yy + zz), xy - wz, xz + wy],
            [xy + wz, 1.0 - (xx + zz), yz - wx],
            [xz - wy, yz + wx, 1.0 - (xx + yy)],
        ]
    )


def _conjugate(orientation: Quaternion) -> Quaternion:
    x, y, z, w = orientation
    return -x, -y, -z, w


def view_matrix(target: Point, distance: float, yaw: float, pitch: float) -> Array:
    """Return the transform from the world to OpenGL's camera frame, shape (4, 4).

    target: the point in the middle [m]. distance: from it [m]. yaw, pitch: where the camera looks,
    counter-clockwise from y and upwards [rad].
    """
    sy, cy, sp, cp = math.sin(yaw), math.cos(yaw), math.sin(pitch), math.cos(pitch)
    ahead = np.array([-sy * cp, cy * cp, sp])
    # OpenGL's camera looks along -z, with x to the right and y up.
    turn = np.stack([np.array([cy, sy, 0.0]), np.array([sy * sp, -cy * sp, cp]), -ahead])
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = -turn @ (target - distance * ahead)
    return matrix


def projection_matrix(fov: float, aspect: float, near: float, far: float) -> Array:
    """Return OpenGL's projection matrix, shape (4, 4).

    fov: vertical field of view [rad]. aspect: width over height [-]. near, far: clipping [m].
    """
    scale = 1.0 / math.tan(fov / 2)
    matrix = np.diag([scale / aspect, scale, (far + near) / (near - far), 0.0])
    matrix[2, 3], matrix[3, 2] = 2 * far * near / (near - far), -1.0
    return matrix
