"""From candidates to a motion, without a planner."""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions, Vector
from stepbus_store.cause import Cause
from stepbus_store.motion.fitting import sampled
from stepbus_store.motion.joint_motion import JointMotion, Motion, MotionLimits, motion_to
from stepbus_store.motion.manipulator.candidates import Candidate
from stepbus_store.motion.outcome import Refused

_SLOWER = (1.0, 1.5, 2.5)
"""Factors on the duration of a motion, tried where the motors are too weak for it."""

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
    ) -> tuple[Candidate, list[Motion]]:
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
    ) -> list[Motion] | None:
        """Return motions to carry out one after the other; None: no path was found.

        start, goal: shape (n,) [rad]. least_duration: of all together [s]. holds: whether the
        motors must be strong enough all along.
        """
        allowed = self._allowed(start, holds)
        for stops in self._paths(start, goal):
            share = least_duration / len(stops)
            motions: list[Motion] = []
            for before, stop in pairwise([start, *stops]):
                motion = self._segment(before, stop, share, allowed)
                if motion is None:
                    break
                motions.append(motion)
            else:
                return motions
        return None

    def _allowed(self, start: Vector, holds: bool) -> Vector:
        """Return the largest torques of a motion, shape (n,) [N·m]."""
        if not holds:
            return np.full(len(start), math.inf)
        # An arm that hangs in its motors' limits must be able to leave.
        there = np.abs(self._robot.gravity_torque(start))
        return np.maximum(self._share * self._robot.effort_limit, 1.02 * there)

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
        self, before: Vector, goal: Vector, least_duration: float, allowed: Vector
    ) -> Motion | None:
        """Return a motion that works, slower where the motors need it; None: there is none."""
        start = JointMotion.at_rest(before)
        states = _states(motion_to(start, goal, self._limits, least_duration))
        static = [self._robot.gravity_torque(state.position) for state in states]
        if any((np.abs(torque) > allowed).any() for torque in static):
            return None
        if any(self._touches(state.position) for state in states):
            return None
        for factor in _SLOWER:
            slower = motion_to(start, goal, self._limits.slowed(factor), least_duration)
            if self._is_strong_enough(slower, allowed):
                return slower
        return None

    def _is_strong_enough(self, motion: Motion, allowed: Vector) -> bool:
        torques = (
            self._robot.inverse_dynamics(state.position, state.velocity, state.acceleration)
            for state in _states(motion)
        )
        return not any((np.abs(torque) > allowed).any() for torque in torques)


def _states(motion: Motion) -> list[JointMotion]:
    # At most 1000: enough for a full turn, however slow it is.
    return sampled(motion, least=1, most=1000)
