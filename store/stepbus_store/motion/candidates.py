"""What a goal wants of the arm, in the robot's base, and the joint positions that would do it."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Indices, RobotModel, Vector
from stepbus_participant import suggest
from stepbus_schemas import Goal
from stepbus_store.cause import Cause
from stepbus_store.motion.branches import BranchSolver
from stepbus_store.motion.follow import Candidate, JointPath, check_path, follow, line
from stepbus_store.motion.ik_search import Solution
from stepbus_store.motion.joint_motion import ManipulatorOptions
from stepbus_store.motion.outcome import FARTHEST, Measured, Refused
from stepbus_store.motion.spiral import SpiralPlanner


def frame_in_base(robot: RobotModel, at: Measured, frame: str) -> Any:
    """Return the pose of a goal's frame in the robot's base, a `pinocchio.SE3`.

    frame: a link, `odometry`, or empty for the base. Raises RunError for an unknown one.
    """
    if frame == "odometry":
        turn = pin.utils.rotate("z", at.base.yaw)
        return pin.SE3(turn, np.array([at.base.x, at.base.y, 0.0])).inverse()
    return robot.frame_pose(at.q, frame)


def target_pose(goal: Goal) -> Any:
    """Return the pose that a goal wants in its frame, a `pinocchio.SE3`; raises Refused if none."""
    if goal.position is None or goal.orientation is None:
        raise Refused(Cause.INVALID, f"type {goal.type} needs position and orientation")
    length = math.hypot(*goal.orientation)
    if not math.isfinite(sum(goal.position)) or not abs(length - 1.0) <= 1e-3:
        text = f"position {goal.position} or orientation {goal.orientation} is no pose"
        raise Refused(
            Cause.INVALID, f"{text}; the quaternion x, y, z, w has length {length:g}, not 1"
        )
    if max(map(abs, goal.position)) > FARTHEST:
        text = f"position {goal.position} m is more than {FARTHEST:g} m away"
        raise Refused(Cause.UNREACHABLE, f"unreachable: {text}")
    turn = pin.Quaternion(np.array(goal.orientation) / length)
    return pin.SE3(turn.matrix(), np.array(goal.position))


def target_joints(goal: Goal, robot: RobotModel, q: Vector) -> tuple[Vector, Indices]:
    """Return the positions that `move_joints` wants, shape (n,) [rad], and which joints it names.

    The other joints stay at q. Raises Refused for unknown joints and values beyond their limits.
    """
    if len(goal.joints) != len(goal.values) or not goal.joints:
        counts = f"{len(goal.values)} values for {len(goal.joints)} joints"
        raise Refused(Cause.INVALID, f"type move_joints has {counts}")
    for name in goal.joints:
        if name not in robot.joints:
            text = f"joint {name!r} is unknown{suggest(name, robot.joints)}"
            raise Refused(Cause.INVALID, text)
    target, named = q.copy(), [robot.joints.index(name) for name in goal.joints]
    for name, index, value in zip(goal.joints, named, goal.values, strict=True):
        low, high = robot.lower[index], robot.upper[index]
        if not low <= value <= high:
            text = f"{name} cannot go to {value:g} {robot.unit(name)}"
            raise Refused(Cause.INVALID, f"{text}, its limits are [{low:g}, {high:g}]")
        target[index] = value
    return target, np.array(named, dtype=np.intp)


_FARTHER = 1.5
"""By how much farther than the nearest solution the arm goes beside a base that drives [rad]."""


def about_as_near(candidates: Iterator[Candidate], rest: Vector) -> Iterator[Candidate]:
    """Yield candidates that are little farther from rest than the first one, shape (n,) [rad]."""
    nearest: float | None = None
    for candidate in candidates:
        away = float(np.linalg.norm(candidate.target - rest))
        nearest = away if nearest is None else nearest
        if away > nearest + _FARTHER:
            return
        yield candidate


class CandidateFinder:
    """Turns goals of an arm into candidates, the nearest first; a planner or router checks them.

    tries_unholdable: what the motors cannot hold is a candidate, too.
    """

    def __init__(
        self, solver: BranchSolver, options: ManipulatorOptions, *, tries_unholdable: bool = False
    ) -> None:
        self._robot, self._solver = solver.robot, solver
        self._options = options
        self._spirals = SpiralPlanner(solver, options.turn_radius)
        self._tries_unholdable = tries_unholdable

    def candidates(self, goal: Goal, rest: Vector, at: Measured) -> Iterator[Candidate]:
        """Return where to go from rest, shape (n,) [rad]; at: measured.

        Raises Refused for a goal of another part, and where there is no candidate; RunError for an
        unknown frame.
        """
        if goal.type == "move_joints":
            target, named = target_joints(goal, self._robot, rest)
            yield self._accepted(self._solver.search.judge(target, named))
            return
        if goal.type not in {"move_to_pose", "spiral"}:
            raise Refused(Cause.INVALID, f"this arm has no goals of type {goal.type}")
        chain = self._solver.chain(goal.tip)
        frame = frame_in_base(self._robot, at, goal.frame)
        target_in_base = frame * target_pose(goal)
        if goal.type == "spiral":
            yield from self._spirals.solve(goal, frame, target_in_base, rest)
        elif chain.solves:
            solutions = self._solver.solve(goal.tip, target_in_base, rest)
            for number, solution in enumerate(solutions, 1):
                yield Candidate(target=solution, text=f"solution {number} of {len(solutions)}")
        else:
            yield self._accepted(self._solver.search.solve(goal.tip, target_in_base, rest))

    def line(self, goal: Goal, rest: Vector, at: Measured) -> JointPath | None:
        """Return the joints along a straight path of the tip; None: the tip is there already.

        Raises Refused where the joints cannot follow it.
        """
        self._solver.chain(goal.tip)
        target = frame_in_base(self._robot, at, goal.frame) * target_pose(goal)
        start = self._robot.frame_pose(rest, goal.tip)
        if not start.isApprox(target):
            # An end that is out of reach is refused with the numbers of how far it is, before a
            # path of very many poses is laid out to it.
            self._solver.solve(goal.tip, target, rest)
        path = line(start, target, self._options.turn_radius)
        if not path:
            return None
        joints = follow(self._robot, goal.tip, path, rest)
        check_path(joints, self._solver.collisions, leaves=True)
        return joints

    def _accepted(self, solution: Solution) -> Candidate:
        holds = solution.verdict == "reached"
        if not holds and not (self._tries_unholdable and solution.verdict == "not_holdable"):
            raise Refused(Cause(solution.verdict), str(solution))
        text = "" if holds else str(solution)
        return Candidate(target=solution.q, text=text, holds=holds)
