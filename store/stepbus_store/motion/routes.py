"""From candidates to a motion, without a planner."""

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions, Vector
from stepbus_store.cause import Cause
from stepbus_store.motion.fitting import fitted, sampled
from stepbus_store.motion.follow import Candidate
from stepbus_store.motion.joint_motion import JointMotion, MotionLimits, motion_to
from stepbus_store.motion.outcome import Refused
from stepbus_store.motion.trajectory import Trajectory

_DETOURS = 60
"""Random poses that are tried."""


class DetourRouter:
    """Finds motions that neither touch nor overload: straight, or with a stop at a random pose.

    collisions: of the robot with itself; None: not checked. effort_share: of the effort limits that
    a motion may need. seed: of the random poses.
    """

    def __init__(
        self,
        robot: RobotModel,
        limits: MotionLimits,
        *,
        seed: int,
        collisions: SelfCollisions | None = None,
        effort_share: float = 1.0,
    ) -> None:
        self._robot = robot
        self._limits = limits
        self._collisions = collisions
        self._share = effort_share
        self._random = np.random.Generator(np.random.PCG64([seed, 1]))

    def route(
        self, start: Vector, candidates: Iterable[Candidate], least_duration: float
    ) -> tuple[Candidate, list[Trajectory]]:
        """Return the first candidate with a motion from start to it, shape (n,) [rad], and that.

        least_duration: of the motion [s]. Raises Refused where no candidate has one.
        """
        for candidate in candidates:
            motions = self.plan(start, candidate.target, least_duration, holds=candidate.holds)
            if motions is not None:
                return candidate, motions
        raise Refused(Cause.NO_PATH, "no motion was found that neither touches nor overloads")

    def plan(
        self, start: Vector, goal: Vector, least_duration: float = 0.0, *, holds: bool = True
    ) -> list[Trajectory] | None:
        """Return motions to carry out one after the other; None: no path was found.

        start, goal: shape (n,) [rad]. least_duration: of all together [s]. holds: whether the
        motors must be strong enough all along.
        """
        for stops in self._paths(start, goal):
            share = least_duration / len(stops)
            motions: list[Trajectory] = []
            for before, stop in pairwise([start, *stops]):
                motion = self._segment(before, stop, share, holds=holds)
                if motion is None:
                    break
                motions.append(motion)
            else:
                return motions
        return None

    def _paths(self, start: Vector, goal: Vector) -> Iterator[list[Vector]]:
        yield [goal]
        moving = np.flatnonzero(start != goal)
        robot = self._robot
        for _ in range(_DETOURS):
            via = start.copy()
            via[moving] = self._random.uniform(robot.lower[moving], robot.upper[moving])
            if not self._touches(via):
                yield [via, goal]

    def _touches(self, q: Vector) -> bool:
        return self._collisions is not None and self._collisions.any(q)

    def _segment(
        self, start: Vector, goal: Vector, least_duration: float, *, holds: bool
    ) -> Trajectory | None:
        """Return a motion that works, slower where the motors need it; None: there is none."""
        motion = motion_to(JointMotion.at_rest(start), goal, self._limits, least_duration)
        # At most 1000 states: enough for a full turn, however slow it is.
        if any(self._touches(state.position) for state in sampled(motion, least=1, most=1000)):
            return None
        if not holds:
            return motion
        try:
            return fitted(motion, self._robot, self._limits, effort_share=self._share)
        except Refused:
            return None
