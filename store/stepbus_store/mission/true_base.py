"""Where the base is, as the simulation knows it: odometry drifts where wheels slide."""

import math

from stepbus_schemas import BaseState, Poses
from stepbus_store.mission.geometry import yaw_of


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
