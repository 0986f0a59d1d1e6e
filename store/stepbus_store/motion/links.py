"""Where the links of a robot are, how fast they move, and the path that they came."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, Vector
from stepbus_schemas import Point, Quaternion
from stepbus_store.cause import Cause
from stepbus_store.motion.joint_motion import JointMotion
from stepbus_store.motion.outcome import Refused

_LINK_RADIUS = 0.1
"""How far the points of a link are from the axis about which it turns [m]."""

_MOST, _EVERY = 2000, 0.01
"""How many commanded poses are kept, and at which distance [rad]."""


class Links:
    """The links of a robot in its base; what is none of them, as what it holds, is at `tip`."""

    def __init__(self, robot: RobotModel, tip: str) -> None:
        self._robot = robot
        self._tip = tip
        self._behind: deque[Vector] = deque(maxlen=_MOST)

    def tip_pose(self, q: Vector) -> tuple[Point, Quaternion]:
        """Return position and orientation of the tip in the base at q, shape (n,) [rad, m]."""
        pose = self._robot.frame_pose(q, self._tip)
        x, y, z = pose.translation.tolist()
        a, b, c, d = pin.Quaternion(pose.rotation).coeffs().tolist()
        return (x, y, z), (a, b, c, d)

    def position(self, link: str, q: Vector) -> Vector:
        """Return where a link is in the base at q, shape (n,) [rad], as shape (3,) [m]."""
        return np.array(self._robot.frame_pose(q, self._frame(link)).translation)

    def speeds(self, now: JointMotion, rate: float) -> Callable[[str], tuple[float, float]]:
        """Return a function: link → its speed at a rate, and at the full rate of `now` [m/s]."""
        if not now.velocity.any():
            return lambda _: (0.0, 0.0)
        twist_of = self._robot.twists(now.position, now.velocity)
        known: dict[str, tuple[float, float]] = {}

        def speeds(link: str) -> tuple[float, float]:
            frame = self._frame(link)
            if frame not in known:
                twist = twist_of(frame)
                linear, angular = (math.sqrt(part.dot(part)) for part in (twist[:3], twist[3:]))
                full = linear + _LINK_RADIUS * angular
                known[frame] = (full * rate, full)
            return known[frame]

        return speeds

    def _frame(self, link: str) -> str:
        return link if link in self._robot.links else self._tip

    def record(self, q: Vector) -> None:
        """Keep a commanded pose, shape (n,) [rad], unless it is close to the newest one."""
        if not self._behind or np.abs(q - self._behind[-1]).max() >= _EVERY:
            self._behind.append(q)

    def take(self, rest: Vector, distance: float) -> tuple[list[Vector], float]:
        """Return poses backwards from rest, shape (n,) [rad], and the length of the tip's path [m].

        They are removed. distance: of the tip, wanted [m]. Raises Refused where none are left.
        """
        points, length = [rest], 0.0
        before = self._robot.frame_pose(rest, self._tip).translation
        while self._behind and length < distance:
            point = self._behind.pop()
            tip = self._robot.frame_pose(point, self._tip).translation
            ahead = float(np.linalg.norm(tip - before))
            if length + ahead > distance:
                self._behind.append(point)
                share = (distance - length) / ahead
                point, ahead = points[-1] + share * (point - points[-1]), distance - length
            points.append(point)
            before, length = tip, length + ahead
        if length < 1e-6:
            text = "the arm has not moved: there is no path to back off along"
            raise Refused(Cause.NO_PATH, text)
        return points, length
