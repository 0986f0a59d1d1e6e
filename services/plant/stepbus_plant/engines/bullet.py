"""PyBullet, imported without its greeting, and its geometry of poses."""

import os
from importlib import import_module
from typing import Any

from stepbus_plant.geometry import Geometry, Pose
from stepbus_schemas import Point, Quaternion


def _import_pybullet() -> Any:
    """Import PyBullet without its greeting on stderr, in C: the date on which it was built.

    In a log, it would be the last thing a plant said.
    """
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        return import_module("pybullet")
    finally:
        os.dup2(kept, 2)
        os.close(kept)
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
