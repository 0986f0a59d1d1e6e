"""What a goal wants of the arm, in the robot's base, and the joint positions that would do it."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Indices, RobotModel, SelfCollisions, Vector
from stepbus_participant import suggest
from stepbus_schemas import BaseState, Goal, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.branches import BranchSolver
from stepbus_store.motion.follow import JointPath, follow, line
from stepbus_store.motion.ik_search import InverseKinematics, Solution
from stepbus_store.motion.manipulator.options import ManipulatorOptions
from stepbus_store.motion.outcome import FARTHEST, Refused
from stepbus_store.motion.spiral import SpiralPlanner

ODOMETRY = "odometry"
"""Frame of a goal: the base's pose at the start."""


def frame_in_base(robot: RobotModel, q: Vector, base: BaseState, frame: str) -> Any:
    """Return the pose of a goal's frame in the robot's base, a `pinocchio.SE3`.

    q: shape (n,) [rad]. frame: a link, `odometry`, or empty for the base. Raises Refused for an
    unknown one.
    """
    if frame == ODOMETRY:
        turn = pin.utils.rotate("z", base.yaw)
        return pin.SE3(turn, np.array([base.x, base.y, 0.0])).inverse()
    try:
        return robot.frame_pose(q, frame)
    except RunError as exc:
        raise Refused(Cause.INVALID, str(exc)) from exc


def target_pose(goal: Goal) -> Any:
    """Return the pose that a goal wants in its own frame, a `pinocchio.SE3`.

    Raises Refused for a goal without a valid pose.
    """
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
    target, named = q.copy(), [_index(robot.joints, name) for name in goal.joints]
    for name, index, value in zip(goal.joints, named, goal.values, strict=True):
        low, high = robot.lower[index], robot.upper[index]
        if not low <= value <= high:
            text = f"{name} cannot go to {value:g} {robot.unit(name)}"
            raise Refused(Cause.INVALID, f"{text}, its limits are [{low:g}, {high:g}]")
        target[index] = value
    return target, np.array(named, dtype=np.intp)


def _index(joints: Sequence[str], name: str) -> int:
    if name not in joints:
        raise Refused(Cause.INVALID, f"joint {name!r} is unknown{suggest(name, joints)}")
    return joints.index(name)


_AT_ONCE = 1e-6
"""Distance of a target that needs no motion [rad]."""

_CHECKED_EVERY = 0.01
"""Distance of the joint positions that are checked [rad]."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """Joint positions to go to, shape (n,) [rad].

    paths: of the joints from there on, over the length of the tip's path [m]. text: description.
    holds: whether the motors can hold the arm there.
    """

    target: Vector
    paths: tuple[JointPath, ...] = ()
    text: str = ""
    holds: bool = True

    def is_at(self, q: Vector) -> bool:
        """Return whether joint positions are those to go to, shape (n,) [rad]."""
        return float(np.abs(self.target - q).max()) < _AT_ONCE


class CandidateFinder(ABC):
    """Turns goals of an arm into candidates, the nearest first."""

    def __init__(self, robot: RobotModel) -> None:
        self.robot = robot

    def candidates(
        self, goal: Goal, rest: Vector, q: Vector, base: BaseState
    ) -> Iterator[Candidate]:
        """Return where to go from rest; q: measured, both of shape (n,) [rad].

        Raises Refused for a goal of another part, and where there is no candidate; RunError for an
        unknown frame.
        """
        match goal.type:
            case "move_joints":
                yield self.from_joints(*target_joints(goal, self.robot, rest))
            case "move_to_pose":
                self._check_tip(goal.tip)
                yield from self.from_pose(goal.tip, self._target(goal, q, base), rest)
            case "spiral":
                self._check_tip(goal.tip)
                frame = frame_in_base(self.robot, q, base, goal.frame)
                yield from self.from_spiral(goal, frame, frame * target_pose(goal), rest)
            case _:
                raise _unsupported(goal)

    def line(self, goal: Goal, rest: Vector, q: Vector, base: BaseState) -> JointPath | None:
        """Return the joints along a straight path of the tip; None: the tip is there already.

        Raises Refused where the joints cannot follow it.
        """
        self._check_tip(goal.tip)
        return self.from_line(goal, self._target(goal, q, base), rest)

    def _target(self, goal: Goal, q: Vector, base: BaseState) -> Any:
        return frame_in_base(self.robot, q, base, goal.frame) * target_pose(goal)

    def _check_tip(self, tip: str) -> None:
        if not self.robot.chain(tip).size:
            raise RunError(f"no joint of this controller moves tip {tip!r}")

    @abstractmethod
    def from_joints(self, target: Vector, named: Indices) -> Candidate:
        """Return joint positions as a candidate; named: joints that the goal names."""

    @abstractmethod
    def from_pose(self, tip: str, target: Any, rest: Vector) -> Iterator[Candidate]:
        """Return the candidates for a pose of the tip in the robot's base."""

    def from_spiral(self, goal: Goal, frame: Any, target: Any, rest: Vector) -> Iterator[Candidate]:
        """Return the candidates for a spiral, in the frame of the goal."""
        raise _unsupported(goal)

    def from_line(self, goal: Goal, target: Any, rest: Vector) -> JointPath | None:
        """Return the joints along a straight path to a pose in the robot's base."""
        raise _unsupported(goal)


def _unsupported(goal: Goal) -> Refused:
    return Refused(Cause.INVALID, f"this arm has no goals of type {goal.type}")


class BranchCandidates(CandidateFinder):
    """All solutions of the inverse kinematics; obstacles are the planner's business.

    collisions: of the robot with itself on lines and spirals; None: not checked.
    """

    def __init__(
        self, robot: RobotModel, options: ManipulatorOptions, solver: BranchSolver,
        spirals: SpiralPlanner, collisions: SelfCollisions | None = None,
    ) -> None:  # fmt: skip
        super().__init__(robot)
        self._collisions = collisions
        self._options = options
        self._solver = solver
        self._spirals = spirals

    def from_joints(self, target: Vector, named: Indices) -> Candidate:
        """See `CandidateFinder`."""
        load = self.robot.overload(target)
        if load is not None:
            raise Refused(Cause.NOT_HOLDABLE, f"not holdable: {load}")
        return Candidate(target=target)

    def from_pose(self, tip: str, target: Any, rest: Vector) -> Iterator[Candidate]:
        """See `CandidateFinder`."""
        solutions = self._solver.solve(tip, target, rest)
        for number, q in enumerate(solutions, 1):
            yield Candidate(target=q, text=f"solution {number} of {len(solutions)}")

    def from_spiral(self, goal: Goal, frame: Any, target: Any, rest: Vector) -> Iterator[Candidate]:
        """See `CandidateFinder`."""
        problem: Refused | None = None
        works = False
        for solution in self._spirals.solve(goal, frame, target, rest):
            try:
                for path in solution.paths:
                    check_path(path, self._collisions)
            except Refused as exc:
                problem = problem or exc
                continue
            works = True
            yield Candidate(target=solution.start, paths=tuple(solution.paths), text=solution.text)
        if not works and problem is not None:
            raise problem

    def from_line(self, goal: Goal, target: Any, rest: Vector) -> JointPath | None:
        """See `CandidateFinder`."""
        start = self.robot.frame_pose(rest, goal.tip)
        if not start.isApprox(target):
            # An end that is out of reach is refused with the numbers of how far it is, before a
            # path of very many poses is laid out to it.
            self._solver.solve(goal.tip, target, rest)
        path = line(start, target, self._options.turn_radius)
        if not path:
            return None
        joints = follow(self.robot, goal.tip, path, rest, self._options.singular_below)
        check_path(joints, self._collisions, leaves=True)
        return joints


def check_path(path: JointPath, collisions: SelfCollisions | None, *, leaves: bool = False) -> None:
    """Raise Refused with both links where the robot would touch itself on a path of the tip.

    leaves: the robot is at its start, and may leave what it touches there.
    """
    if collisions is None:
        return
    far = float(np.abs(np.diff(path.q, axis=0)).max(axis=1).sum())
    count = max(math.ceil(far / _CHECKED_EVERY), 1)
    known = collisions.pair(path.q[0]) if leaves else None
    for u in np.linspace(path.u[0], path.u[-1], count + 1):
        q, _, _ = path.at(float(u))
        pair = collisions.pair(q) if collisions.any(q) else None
        if pair is not None and pair != known:
            text = f"{pair[0]} would touch {pair[1]} after {u - path.u[0]:.3f} m of the path"
            raise Refused(Cause.IN_COLLISION, text)


class SearchedCandidates(CandidateFinder):
    """The best solution of a search that checks for self-collisions.

    tries_unholdable: poses that the motors cannot hold are candidates, too.
    """

    def __init__(
        self, robot: RobotModel, ik: InverseKinematics, *, tries_unholdable: bool = False
    ) -> None:
        super().__init__(robot)
        self._ik = ik
        self._tries_unholdable = tries_unholdable

    def from_joints(self, target: Vector, named: Indices) -> Candidate:
        """See `CandidateFinder`."""
        return self._accepted(self._ik.judge(target, named))

    def from_pose(self, tip: str, target: Any, rest: Vector) -> Iterator[Candidate]:
        """See `CandidateFinder`."""
        yield self._accepted(self._ik.solve(tip, target, rest))

    def _accepted(self, solution: Solution) -> Candidate:
        holds = solution.verdict == "reached"
        if not holds and not (self._tries_unholdable and solution.verdict == "not_holdable"):
            raise Refused(Cause(solution.verdict), str(solution))
        return Candidate(target=solution.q, text=str(solution), holds=holds)
