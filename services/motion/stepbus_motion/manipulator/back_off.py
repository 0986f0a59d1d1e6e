"""The way that an arm has come, so that it can go back on it."""

from __future__ import annotations

from collections import deque

import numpy as np

from stepbus_kinematics import RobotModel, Vector
from stepbus_motion.goals.outcome import Refused

_EVERY = 0.01
"""Distance of the poses that are kept [rad]."""

_MOST = 2000


class WayBack:
    """Remembers commanded poses, the newest 2000; tip: frame whose way counts."""

    def __init__(self, robot: RobotModel, tip: str) -> None:
        self._robot = robot
        self._tip = tip
        self._behind: deque[Vector] = deque(maxlen=_MOST)

    def remember(self, q: Vector) -> None:
        """Keep a pose, shape (n,) [rad], unless it is as good as the newest one."""
        if not self._behind or np.abs(q - self._behind[-1]).max() >= _EVERY:
            self._behind.append(q)

    def take(self, rest: Vector, distance: float) -> tuple[list[Vector], float]:
        """Return poses backwards from rest, shape (n,) [rad], and the way of the tip [m].

        They are forgotten. distance: of the tip, wanted [m]. Raises Refused where there is no way.
        """
        points, length = [rest], 0.0
        before = self._place(rest)
        while self._behind and length < distance:
            point = self._behind.pop()
            place = self._place(point)
            ahead = float(np.linalg.norm(place - before))
            if length + ahead > distance:
                self._behind.append(point)
                share = (distance - length) / ahead
                point, ahead = points[-1] + share * (point - points[-1]), distance - length
            points.append(point)
            before, length = place, length + ahead
        if length < 1e-6:
            raise Refused("no_way", "the arm has not come any way that it could go back")
        return points, length

    def _place(self, q: Vector) -> Vector:
        place: Vector = self._robot.frame_pose(q, self._tip).translation
        return place
