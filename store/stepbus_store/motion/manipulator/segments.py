"""The path that an arm has come, so that it can back off along it."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import RobotModel, Vector
from stepbus_schemas import Point
from stepbus_store.cause import Cause
from stepbus_store.motion.fitting import fitted
from stepbus_store.motion.follow import JointPath
from stepbus_store.motion.joint_motion import MotionLimits
from stepbus_store.motion.manipulator.candidates import Candidate
from stepbus_store.motion.outcome import Refused
from stepbus_store.motion.trajectory import AlongPath, Trajectory

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


_FARTHER = 1.5
"""By how much farther than the nearest solution the arm goes beside a base that drives [rad]."""


@dataclass(frozen=True, kw_only=True)
class Beside:
    """The base moves beside the arm: bases are its poses at which the path of the arm is checked.

    waits: the arm moves only once it is released.
    """

    bases: Sequence[Point] = ()
    waits: bool = False


def about_as_near(candidates: Iterator[Candidate], rest: Vector) -> Iterator[Candidate]:
    """Yield candidates that are little farther from rest than the first one, shape (n,) [rad]."""
    nearest: float | None = None
    for candidate in candidates:
        away = float(np.linalg.norm(candidate.target - rest))
        nearest = away if nearest is None else nearest
        if away > nearest + _FARTHER:
            return
        yield candidate


class SegmentFitter:
    """Times the paths of a candidate, and slows motions down until the motors can follow.

    limits: of the joints. tip: limits along a path of the tip, shape (1,). effort_share: of the
    effort limits that motions may need.
    """

    def __init__(
        self, robot: RobotModel, limits: MotionLimits, tip: MotionLimits, effort_share: float
    ) -> None:
        self._robot = robot
        self._limits = limits
        self._tip = tip
        self._share = effort_share

    def along(self, candidate: Candidate) -> list[Trajectory]:
        """Return the motions along the paths of a candidate."""
        return [self.timed(path) for path in candidate.paths]

    def timed(self, path: JointPath) -> Trajectory:
        """Return the motion along one path."""
        return AlongPath(path, self._tip)

    def fitted(self, parts: list[Trajectory], duration: float) -> list[Trajectory]:
        """Return motions within the limits, together no shorter than a duration [s]."""
        within = [self._fitted(part) for part in parts]
        total = sum(part.duration for part in within)
        if not 0 < total < duration:
            return within
        return [self._fitted(part, part.duration * duration / total) for part in within]

    def _fitted(self, part: Trajectory, least_duration: float = 0.0) -> Trajectory:
        return fitted(
            part,
            self._robot,
            self._limits,
            effort_share=self._share,
            least_duration=least_duration,
        )
