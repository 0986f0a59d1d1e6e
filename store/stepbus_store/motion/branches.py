"""Analytic inverse kinematics of six revolute joints."""

import itertools
import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from eaik.IK_HP import HPRobot

from stepbus_kinematics import Indices, Overload, RobotModel, SelfCollisions, Vector
from stepbus_schemas import RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.ik_search import (
    SINGULAR_BELOW,
    InverseKinematics,
    smallest_singular_value,
)
from stepbus_store.motion.outcome import Refused

TURN = 2 * math.pi

_EXACT = 1e-6
"""Largest error of a branch, of any entry of the pose [m, -]; others are none."""

_SAME = 1e-6
"""Joint distance below which two branches are one [rad]."""


class AnalyticChain:
    """Analytic inverse kinematics of six revolute joints in a row, by eaik.

    Ostermeier, Külz, Althoff: Automatic Geometric Decomposition for Analytical Inverse Kinematics,
    IEEE RA-L, 2025. tip: frame fixed to the last of them. Raises RunError for an unknown frame.
    """

    def __init__(self, robot: RobotModel, tip: str) -> None:
        self.made_from = robot, tip
        self._robot = robot
        self._tip = robot.frame_id(tip)
        self._solver: Any = None
        model, data = robot.model, robot.data
        # The joints that move the tip, starting at the base.
        names = sorted((robot.joints[n] for n in robot.chain(tip)), key=model.getJointId)
        ids = [model.getJointId(name) for name in names]
        types = [model.joints[number].shortname() for number in ids]
        if len(types) != 6 or not all(name.startswith("JointModelR") for name in types):
            return
        # Give eaik the axes and their positions, with all joints at 0, in the base's axes.
        self._order = np.array([robot.joints.index(name) for name in names], dtype=np.intp)
        pin.computeJointJacobians(model, data, robot.in_model(np.zeros(len(robot.joints))))
        pin.updateFramePlacements(model, data)
        axes = []
        for number in ids:
            matrix = pin.getJointJacobian(model, data, number, pin.ReferenceFrame.WORLD)
            axes.append(matrix[3:, model.idx_vs[number]])
        origins = np.array([data.oMi[number].translation for number in ids])
        offsets = np.diff(origins, axis=0, prepend=np.zeros((1, 3)))
        self._turned_at_zero = data.oMi[ids[-1]].rotation.copy()
        self._tip_in_last = data.oMi[ids[-1]].inverse() * data.oMf[self._tip]
        solver = HPRobot(np.array(axes), np.vstack([offsets, np.zeros(3)]))
        if solver.hasKnownDecomposition():
            self._solver = solver

    @property
    def solves(self) -> bool:
        """Return whether six revolute joints move the tip, and their geometry is one it solves."""
        return self._solver is not None

    def branches(self, target: Any, q: Vector) -> list[Vector]:
        """Return all solutions for a pose of the tip, each of shape (n,) in [-π, π] [rad].

        target: in the robot's base, a `pinocchio.SE3`. q: shape (n,) [rad]; joints that do not
        move the tip stay there. Forward kinematics verified each; limits are not checked.
        """
        if self._solver is None:
            return []
        last = (target * self._tip_in_last.inverse()).homogeneous
        # eaik counts the orientation from the one with all joints at 0.
        last[:3, :3] = last[:3, :3] @ self._turned_at_zero.T
        branches: list[Vector] = []
        for row in self._solver.IK(last).Q:
            branch = q.copy()
            branch[self._order] = _wrapped(np.array(row))
            is_new = all(np.abs(_wrapped(branch - other)).max() > _SAME for other in branches)
            if is_new and self._reaches(branch, target):
                branches.append(branch)
        return branches

    def _reaches(self, q: Vector, target: Any) -> bool:
        model, data = self._robot.model, self._robot.data
        pin.framesForwardKinematics(model, data, self._robot.in_model(q))
        error = data.oMf[self._tip].homogeneous - target.homogeneous
        return bool(np.abs(error).max() < _EXACT)


def _wrapped(angle: Vector) -> Vector:
    """Return angles in [-π, π] [rad]."""
    return np.asarray(np.remainder(angle + math.pi, TURN) - math.pi)


class BranchSolver:
    """Finds the solutions for a pose of a frame, the nearest first.

    Where a chain has no analytic solution, `search` finds one; seed: see there. effort_share: of
    the effort limits that holding still may take. collisions: of the robot with itself, in that
    search and on lines and spirals; None: not checked.
    """

    def __init__(
        self,
        robot: RobotModel,
        *,
        seed: int,
        effort_share: float = 1.0,
        collisions: SelfCollisions | None = None,
    ) -> None:
        self.robot, self.collisions = robot, collisions
        self._effort_share = effort_share
        # Weighted so, a distance is a time.
        self._weights = 1.0 / robot.velocity_limit
        self.search = InverseKinematics(robot, seed=seed, collisions=collisions)
        self._chains: dict[str, AnalyticChain] = {}

    def chain(self, tip: str) -> AnalyticChain:
        """Return the solver of a frame; raises RunError for an unknown one, or a fixed one."""
        if tip not in self._chains:
            if not self.robot.chain(tip).size:
                raise RunError(f"no joint of this controller moves tip {tip!r}")
            self._chains[tip] = AnalyticChain(self.robot, tip)
        return self._chains[tip]

    def solve(self, tip: str, target: Any, q: Vector) -> list[Vector]:
        """Return solutions, each of shape (n,) [rad]: each branch once, then with full turns.

        Both parts are ordered by the weighted distance from q, shape (n,) [rad]. target: in the
        robot's base, a `pinocchio.SE3`. Raises Refused with cause unreachable, limits, singular or
        not_holdable, and numbers; RunError for an unknown frame.
        """
        branches = self.chain(tip).branches(target, q)
        if not branches:
            solution = self.search.solve(tip, target, q)
            if solution.verdict != "reached":
                raise Refused(Cause(solution.verdict), str(solution))
            return [solution.q]
        inside = [turns for branch in branches if (turns := self._turns(branch, q))]
        if not inside:
            raise Refused(Cause.LIMITS, self._limits_text(branches))
        singular = [self.smallest(tip, turns[0]) for turns in inside]
        if max(singular) < SINGULAR_BELOW:
            text = f"singular: the best of {len(inside)} solutions has a smallest singular value of"
            needs = f"{max(singular):.4f}; at least {SINGULAR_BELOW:.4f} is needed"
            raise Refused(Cause.SINGULAR, f"{text} {needs}")
        regular = list(itertools.compress(inside, (one >= SINGULAR_BELOW for one in singular)))
        loads = [self.overload(tip, turns[0]) for turns in regular]
        holdable = [turns for turns, load in zip(regular, loads, strict=True) if load is None]
        if not holdable:
            known = (load for load in loads if load is not None)
            least = min(known, key=lambda load: load.required - load.available)
            raise Refused(Cause.NOT_HOLDABLE, f"not holdable: {least}, even in the best solution")
        away = partial(self._distance, q)
        turned = itertools.chain.from_iterable(turns[1:] for turns in holdable)
        return sorted((turns[0] for turns in holdable), key=away) + sorted(turned, key=away)

    def is_reachable(self, tip: str, target: Any, q: Vector) -> bool:
        """Return whether any solution is good, without asking why not."""
        chain = self.chain(tip)
        if chain.solves:
            return any(self._is_good(tip, branch) for branch in chain.branches(target, q))
        return self.search.solve(tip, target, q).verdict == "reached"

    def _is_good(self, tip: str, branch: Vector) -> bool:
        first, last = self._spans(branch)
        regular = bool((first <= last).all()) and self.smallest(tip, branch) >= SINGULAR_BELOW
        return regular and self.overload(tip, branch) is None

    def _spans(self, branch: Vector) -> tuple[Indices, Indices]:
        """Return the first and the last full turn of each joint that its limits allow."""
        first = np.ceil((self.robot.lower - branch) / TURN).astype(np.intp)
        last = np.floor((self.robot.upper - branch) / TURN).astype(np.intp)
        return first, last

    def _turns(self, branch: Vector, q: Vector) -> list[Vector]:
        """Return a branch with full turns of its joints within their limits, the nearest first."""
        first, last = self._spans(branch)
        spans = [range(low, high + 1) for low, high in zip(first, last, strict=True)]
        turned = branch + TURN * np.array(list(itertools.product(*spans))).reshape(-1, len(branch))
        order = np.argsort(np.linalg.norm(self._weights * (turned - q), axis=1), kind="stable")
        return list(turned[order])

    def _distance(self, q: Vector, solution: Vector) -> float:
        return float(np.linalg.norm(self._weights * (solution - q)))

    def smallest(self, tip: str, q: Vector) -> float:
        """Return the smallest singular value of a frame's Jacobian at q, lengths in [m]."""
        robot = self.robot
        _, jacobian = robot.jacobian(q, robot.frame_id(tip))
        return smallest_singular_value(jacobian[:, robot.chain(tip)])

    def overload(self, tip: str, q: Vector) -> Overload | None:
        """Return the joint that cannot hold the arm at q with its share of the effort limit."""
        robot = self.robot
        return robot.overload(q, robot.chain(tip), self._effort_share)

    def _limits_text(self, branches: Sequence[Vector]) -> str:
        """Return a sentence on the joint for which the best branch fails; any full turn counts."""
        robot, turns = self.robot, TURN * np.array([[-1.0], [0.0], [1.0]])
        angles = [branch + turns for branch in branches]
        beyond = [np.maximum(robot.lower - one, one - robot.upper).clip(0.0) for one in angles]
        best = int(np.argmin([rows.min(axis=0).max() for rows in beyond]))
        branch, worst = branches[best], int(np.argmax(beyond[best].min(axis=0)))
        return (
            f"out of limits: {robot.joints[worst]} would have to go to {branch[worst]:.3f} rad, "
            f"its limits are [{robot.lower[worst]:.3f}, {robot.upper[worst]:.3f}]"
        )
