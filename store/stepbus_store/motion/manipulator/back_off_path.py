"""The path that an arm has come, so that it can back off along it."""

from collections import deque

import numpy as np

from stepbus_kinematics import RobotModel, Vector
from stepbus_store.cause import Cause
from stepbus_store.motion.outcome import Refused

_EVERY = 0.01
"""Distance of the poses that are kept [rad]."""

_MOST = 2000


class BackOffPath:
    """Records commanded poses, the newest 2000; tip: frame whose path counts."""

    def __init__(self, robot: RobotModel, tip: str) -> None:
        self._robot = robot
        self._tip = tip
        self._behind: deque[Vector] = deque(maxlen=_MOST)

    def record(self, q: Vector) -> None:
        """Keep a pose, shape (n,) [rad], unless it is close to the newest one."""
        if not self._behind or np.abs(q - self._behind[-1]).max() >= _EVERY:
            self._behind.append(q)

    def take(self, rest: Vector, distance: float) -> tuple[list[Vector], float]:
        """Return poses backwards from rest, shape (n,) [rad], and the length of the tip's path [m].

        They are removed. distance: of the tip, wanted [m]. Raises Refused where none are left.
        """
        points, length = [rest], 0.0
        before = self._tip_at(rest)
        while self._behind and length < distance:
            point = self._behind.pop()
            tip = self._tip_at(point)
            ahead = float(np.linalg.norm(tip - before))
            if length + ahead > distance:
                self._behind.append(point)
                share = (distance - length) / ahead
                point, ahead = points[-1] + share * (point - points[-1]), distance - length
            points.append(point)
            before, length = tip, length + ahead
        if length < 1e-6:
            raise Refused(
                Cause.NO_PATH, "the arm has not moved: there is no path to back off along"
            )
        return points, length

    def _tip_at(self, q: Vector) -> Vector:
        position: Vector = self._robot.frame_pose(q, self._tip).translation
        return position
