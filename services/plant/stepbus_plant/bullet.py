"""PyBullet, imported without its greeting, and its geometry of poses."""

import ctypes
import math
import os
from collections.abc import Iterable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Point, Quaternion

Array = NDArray[np.float64]
Pose = tuple[Point, Quaternion]
"""Position [m], and orientation as x, y, z, w."""
_NO_TURN = (0.0, 0.0, 0.0, 1.0)


def _import_pybullet() -> Any:
    """Import PyBullet, which prints when it was built: to descriptor 2 instead of 1.

    It does so in C, and where a run is in the process of the user's program, 1 is that program's.
    """
    flush = ctypes.CDLL(None).fflush
    try:
        stdout, stderr = os.dup(1), os.dup(2)
    except OSError:
        return import_module("pybullet")
    flush(None)
    os.dup2(stderr, 1)
    try:
        return import_module("pybullet")
    finally:
        flush(None)
        os.dup2(stdout, 1)
        os.close(stdout)
        os.close(stderr)


bullet = _import_pybullet()


def compose(one: Pose, other: Pose) -> Pose:
    """Return the pose that `other` is in the frame that `one` is given in."""
    pose: Pose = bullet.multiplyTransforms(*one, *other)
    return pose


def inverse(pose: Pose) -> Pose:
    """Return the pose of the frame that a pose is given in, in the frame of the pose."""
    inverted: Pose = bullet.invertTransform(*pose)
    return inverted


def out_of(frame: Pose, point: Point) -> Point:
    """Return a point of a frame in the world."""
    return compose(frame, (point, _NO_TURN))[0]


def into(frame: Pose, point: Point) -> Point:
    """Return a point of the world in a frame."""
    return out_of(inverse(frame), point)


def turned(orientation: Quaternion, direction: Point) -> Point:
    """Return a direction of a frame in the world."""
    in_world: Point = bullet.rotateVector(orientation, direction)
    return in_world


def between(one: Pose, other: Pose, share: float) -> Pose:
    """Return the pose at a share of the way from one to another, turned evenly."""
    x, y, z = (a + share * (b - a) for a, b in zip(one[0], other[0], strict=True))
    orientation: Quaternion = bullet.getQuaternionSlerp(one[1], other[1], share)
    return (x, y, z), orientation


def spin_between(one: Quaternion, other: Quaternion, seconds: float) -> Point:
    """Return the angular velocity that turns one orientation into another in that time [rad/s]."""
    axis, angle = bullet.getAxisAngleFromQuaternion(bullet.getDifferenceQuaternion(one, other))
    angle = math.remainder(angle, 2 * math.pi)
    x, y, z = (part * angle / seconds for part in axis)
    return x, y, z


def quaternion(rpy: Iterable[float]) -> Quaternion:
    """Return the quaternion of roll, pitch, yaw about fixed axes [rad]."""
    orientation: Quaternion = bullet.getQuaternionFromEuler(rpy)
    return orientation


def rotation(orientation: Quaternion) -> Array:
    """Return the matrix of a quaternion, shape (3, 3)."""
    matrix: Array = np.reshape(bullet.getMatrixFromQuaternion(orientation), (3, 3))
    return matrix
