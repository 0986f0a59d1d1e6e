"""PyBullet, imported without its greeting, and its geometry of poses."""

import ctypes
import os
from importlib import import_module
from typing import Any

from stepbus_plant.geometry import Geometry, Pose
from stepbus_schemas import Point, Quaternion


def _import_pybullet() -> Any:
    """Import PyBullet without what it prints in C, on descriptor 1 or 2: when it was built.

    These may be those of the user's program; in a log, it would be the last thing a plant said.
    """
    flush = ctypes.CDLL(None).fflush
    try:
        kept, nowhere = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    except OSError:
        return import_module("pybullet")
    flush(None)
    for number in (1, 2):
        os.dup2(nowhere, number)
    try:
        return import_module("pybullet")
    finally:
        flush(None)
        for number, descriptor in enumerate(kept, 1):
            os.dup2(descriptor, number)
            os.close(descriptor)
        os.close(nowhere)


bullet = _import_pybullet()


class BulletGeometry(Geometry):
    """PyBullet's own geometry, in single precision."""

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
