"""Which way to a pose: straight, or by way of other poses, without touching or overloading."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions, Vector
from stepbus_motion.paths.motion import JointMotion, Motion, MotionLimits, motion_to

_SLOWER = (1.0, 1.5, 2.5)
"""Factors on the time of a motion that are tried where the motors are too weak for it."""

_CHECKED_EVERY_S = 0.04
"""Distance of the poses of a motion that are looked at [s]."""

_MOST_CHECKED = 1000
"""Poses of a motion that are looked at: enough for a full turn, however slow it is."""


class Planner:
    """Finds motions that neither touch anything nor need more torque than there is.

    limits: of the motion. collisions: None: they are not looked at. detours: how many random
    poses are tried as a stop on the way.
    """

    def __init__(
        self,
        robot: RobotModel,
        limits: MotionLimits,
        *,
        seed: int,
        collisions: SelfCollisions | None = None,
        detours: int = 60,
    ) -> None:
        self._robot = robot
        self._limits = limits
        self._collisions = collisions
        self._detours = detours
        self._random = np.random.Generator(np.random.PCG64([seed, 1]))

    def plan(
        self, start: JointMotion, goal: Vector, least_duration: float = 0.0, *, holds: bool = True
    ) -> list[Motion] | None:
        """Return motions to carry out one after the other; None: no way was found.

        goal: shape (n,) [rad]. least_duration: of all together [s]. holds: whether the motors
        have to be strong enough all the way.
        """
        allowed = self._allowed(start, holds)
        for way in self._ways(start.position, goal):
            share = least_duration / len(way)
            motions: list[Motion] = []
            at = start
            for stop in way:
                motion = self._leg(at, stop, share, allowed)
                if motion is None:
                    break
                motions.append(motion)
                at = JointMotion.at_rest(stop)
            else:
                return motions
        return None

    def _allowed(self, start: JointMotion, holds: bool) -> Vector:
        """Return the largest torques of a motion, shape (n,) [N·m].

        An arm that hangs in its motors' limits has to be allowed to leave.
        """
        if not holds:
            return np.full(len(start.position), math.inf)
        there = np.abs(self._robot.gravity_torque(start.position))
        return np.maximum(self._robot.effort_limit, 1.02 * there)

    def _ways(self, start: Vector, goal: Vector) -> Iterator[list[Vector]]:
        yield [goal]
        moving = np.flatnonzero(start != goal)
        robot = self._robot
        for _ in range(self._detours):
            via = start.copy()
            via[moving] = self._random.uniform(robot.lower[moving], robot.upper[moving])
            if not self._touches(via):
                yield [via, goal]

    def _touches(self, q: Vector) -> bool:
        return self._collisions is not None and self._collisions.any(q)

    def _leg(
        self, start: JointMotion, goal: Vector, least_duration: float, allowed: Vector
    ) -> Motion | None:
        """Return a motion that works, slower where the motors want it; None: there is none."""
        motion = motion_to(start, goal, self._limits, least_duration)
        poses = _sampled(motion)
        static = [self._robot.gravity_torque(pose.position) for pose in poses]
        if any((np.abs(torque) > allowed).any() for torque in static):
            return None
        if any(self._touches(pose.position) for pose in poses):
            return None
        for factor in _SLOWER:
            slower = motion_to(start, goal, self._limits.slowed(factor), least_duration)
            if self._is_strong_enough(slower, allowed):
                return slower
        return None

    def _is_strong_enough(self, motion: Motion, allowed: Vector) -> bool:
        for pose in _sampled(motion):
            torque = self._robot.inverse_dynamics(pose.position, pose.velocity, pose.acceleration)
            if (np.abs(torque) > allowed).any():
                return False
        return True


def _sampled(motion: Motion) -> list[JointMotion]:
    count = min(max(math.ceil(motion.duration / _CHECKED_EVERY_S), 1), _MOST_CHECKED)
    return [motion.at(motion.duration * i / count) for i in range(count + 1)]
