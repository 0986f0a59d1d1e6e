"""From candidates to a motion, without a planner."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions, Vector
from stepbus_store.cause import Cause
from stepbus_store.motion.fitting import sampled
from stepbus_store.motion.joint_motion import (
    JointMotion,
    Motion,
    MotionLimits,
    motion_to,
    stop_from,
)
from stepbus_store.motion.manipulator.candidates import Candidate
from stepbus_store.motion.manipulator.segments import SegmentFitter
from stepbus_store.motion.outcome import Refused
from stepbus_store.motion.trajectory import Joined, Trajectory

_SLOWER = (1.0, 1.5, 2.5)
"""Factors on the duration of a motion, tried where the motors are too weak for it."""


@dataclass(frozen=True, kw_only=True)
class Route:
    """A motion to a candidate; text: description."""

    candidate: Candidate
    trajectory: Trajectory
    text: str


class DirectRouter:
    """Goes straight in joint space, slowed down until the motors can follow.

    collisions: of the robot with itself; None: not checked. Obstacles are not.
    """

    def __init__(
        self, limits: MotionLimits, fitter: SegmentFitter, collisions: SelfCollisions | None = None
    ) -> None:
        self._limits = limits
        self._fitter = fitter
        self._collisions = collisions

    def route(
        self, start: JointMotion, candidates: Iterable[Candidate], least_duration: float
    ) -> Route:
        """Return a motion to the first candidate that works, from joints that may be moving.

        least_duration: of the motion [s]. Raises Refused where no candidate works.
        """
        problem: Refused | None = None
        for candidate in candidates:
            try:
                trajectory = self._trajectory(start, candidate, least_duration)
                self._check(trajectory)
            except Refused as exc:
                problem = problem or exc
                continue
            text = f"{trajectory.duration:.2f} s of motion"
            text = f"{candidate.text}; {text}" if candidate.text else text
            return Route(candidate=candidate, trajectory=trajectory, text=text)
        raise problem or Refused(Cause.NO_PATH, "the goal has no solution")

    def _check(self, trajectory: Trajectory) -> None:
        if self._collisions is None:
            return
        states = sampled(trajectory)
        known = self._collisions.pair(states[0].position)
        for state in states:
            pair = self._collisions.pair(state.position)
            if pair is not None and pair != known:
                raise Refused(Cause.IN_COLLISION, f"{pair[0]} would touch {pair[1]} on the path")

    def _trajectory(self, start: JointMotion, candidate: Candidate, least: float) -> Trajectory:
        rows = self._fitter.along(candidate)
        first = motion_to(start, candidate.target, self._limits, 0.0 if rows else least)
        parts = self._fitter.fitted([first, *rows], least)
        if not start.velocity.any() or parts[0] is first:
            return Joined(parts)
        # It cannot be slowed down from its start: then it starts at rest.
        braking = stop_from(start, self._limits)
        rest = JointMotion.at_rest(braking.at(braking.duration).position)
        first = motion_to(rest, candidate.target, self._limits)
        return Joined([braking, *self._fitter.fitted([first, *rows], least)])


class DetourRouter:
    """Finds motions that neither touch nor overload: straight, or with a stop at a random pose.

    collisions: None: not checked. detours: random poses that are tried.
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

    def route(
        self, start: JointMotion, candidates: Iterable[Candidate], least_duration: float
    ) -> Route:
        """Return a motion to the nearest candidate; see `DirectRouter.route`."""
        candidate = next(iter(candidates))
        motions = self.plan(start, candidate.target, least_duration, holds=candidate.holds)
        if motions is None:
            raise Refused(Cause.NO_PATH, "no motion was found that neither touches nor overloads")
        trajectory = Joined(motions)
        text = f"{trajectory.duration:.2f} s of motion in {len(motions)} parts"
        text = f"{candidate.text}; {text}"
        return Route(candidate=candidate, trajectory=trajectory, text=text)

    def plan(
        self, start: JointMotion, goal: Vector, least_duration: float = 0.0, *, holds: bool = True
    ) -> list[Motion] | None:
        """Return motions to carry out one after the other; None: no path was found.

        goal: shape (n,) [rad]. least_duration: of all together [s]. holds: whether the motors
        must be strong enough all along.
        """
        allowed = self._allowed(start, holds)
        for stops in self._paths(start.position, goal):
            share = least_duration / len(stops)
            motions: list[Motion] = []
            at = start
            for stop in stops:
                motion = self._segment(at, stop, share, allowed)
                if motion is None:
                    break
                motions.append(motion)
                at = JointMotion.at_rest(stop)
            else:
                return motions
        return None

    def _allowed(self, start: JointMotion, holds: bool) -> Vector:
        """Return the largest torques of a motion, shape (n,) [N·m]."""
        if not holds:
            return np.full(len(start.position), math.inf)
        # An arm that hangs in its motors' limits must be able to leave.
        there = np.abs(self._robot.gravity_torque(start.position))
        return np.maximum(self._robot.effort_limit, 1.02 * there)

    def _paths(self, start: Vector, goal: Vector) -> Iterator[list[Vector]]:
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

    def _segment(
        self, start: JointMotion, goal: Vector, least_duration: float, allowed: Vector
    ) -> Motion | None:
        """Return a motion that works, slower where the motors need it; None: there is none."""
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
