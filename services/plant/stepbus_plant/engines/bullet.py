"""PyBullet, imported without its greeting, and its geometry of poses."""

import ctypes
import math
import os
from importlib import import_module
from typing import Any

from stepbus_plant.geometry import Geometry, Pose
from stepbus_schemas import Point, Quaternion


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


class BulletGeometry(Geometry):
    """PyBullet's own geometry: in single precision, but for angles."""

    def compose(self, one: Pose, other: Pose) -> Pose:
        """See `Geometry`."""
        pose: Pose = bullet.multiplyTransforms(*one, *other)
        return pose

    def inverse(self, pose: Pose) -> Pose:
        """See `Geometry`."""
        inverted: Pose = bullet.invertTransform(*pose)
        return inverted

    def turned(self, orientation: Quaternion, direction: Point) -> Point:
        """See `Geometry`."""
        in_world: Point = bullet.rotateVector(orientation, direction)
        return in_world

    def _slerp(self, one: Quaternion, other: Quaternion, share: float) -> Quaternion:
        orientation: Quaternion = bullet.getQuaternionSlerp(one, other, share)
        return orientation

    def spin_between(self, one: Quaternion, other: Quaternion, seconds: float) -> Point:
        """See `Geometry`."""
        axis, angle = bullet.getAxisAngleFromQuaternion(bullet.getDifferenceQuaternion(one, other))
        angle = math.remainder(angle, 2 * math.pi)
        x, y, z = (part * angle / seconds for part in axis)
        return x, y, z
