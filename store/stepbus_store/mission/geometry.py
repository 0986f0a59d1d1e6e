"""Planar geometry of objects on level ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stepbus_schemas import BaseState, Poses, Quaternion
from stepbus_store.poses import yaw_of

_QUARTER = math.pi / 2


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A point with a heading: x, y [m], yaw [rad], in the frame of odometry."""

    x: float
    y: float
    yaw: float

    def ahead(self, distance: float, left: float = 0.0) -> Spot:
        """Return the spot this far ahead and to the left [m], with the same heading."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Spot(
            x=self.x + c * distance - s * left, y=self.y + s * distance + c * left, yaw=self.yaw
        )

    def sees(self, x: float, y: float) -> tuple[float, float]:
        """Return how far a point is ahead and to the left [m]."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return c * (x - self.x) + s * (y - self.y), c * (y - self.y) - s * (x - self.x)


def spot_of(base: BaseState) -> Spot:
    """Return the pose of a base according to its odometry."""
    return Spot(x=base.x, y=base.y, yaw=base.yaw)


def gripper_down(yaw: float) -> Quaternion:
    """Return the orientation of a gripper that points down and opens along a heading [rad].

    Its z axis points down, its y axis along the heading; quaternion x, y, z, w.
    """
    c, s = math.cos(yaw / 2), math.sin(yaw / 2)
    half = math.sqrt(0.5)
    return (half * (c - s), half * (c + s), 0.0, 0.0)


def tilt_of(q: Quaternion) -> float:
    """Return the angle between the z axis of an orientation and the vertical [rad]."""
    x, y, z, w = q
    length = x * x + y * y + z * z + w * w
    return math.acos(max(-1.0, min(1.0, 1 - 2 * (x * x + y * y) / length)))


def nearest_quarter(yaw: float, towards: float) -> float:
    """Return the yaw of a box turned by quarter turns, nearest to another one [rad]."""
    return yaw - _QUARTER * round((yaw - towards) / _QUARTER)


class TrueBase:
    """Follows the pose of the base from one true pose to the next by odometry.

    index: of its link among the poses.
    """

    def __init__(self, index: int) -> None:
        self._index = index
        self._turn = 0.0
        self._offset = (0.0, 0.0)

    def see(self, poses: Poses, odometry: BaseState) -> None:
        """Take a true pose, and odometry of the same step."""
        x, y, _ = poses.position[self._index]
        self._turn = yaw_of(poses.orientation[self._index]) - odometry.yaw
        u, v = self._turned(odometry.x, odometry.y)
        self._offset = (x - u, y - v)

    def pose(self, odometry: BaseState) -> BaseState:
        """Return where the base is in the world."""
        (dx, dy), (u, v) = self._offset, self._turned(odometry.x, odometry.y)
        yaw = odometry.yaw + self._turn
        return BaseState(x=dx + u, y=dy + v, yaw=yaw, vx=odometry.vx, wz=odometry.wz)

    def _turned(self, x: float, y: float) -> tuple[float, float]:
        cos, sin = math.cos(self._turn), math.sin(self._turn)
        return cos * x - sin * y, sin * x + cos * y
