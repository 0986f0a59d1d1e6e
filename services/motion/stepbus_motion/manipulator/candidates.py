"""Where the joints may go for a goal: one way to stand after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from stepbus_kinematics import RobotModel, Vector
from stepbus_motion.goals.outcome import Refused
from stepbus_motion.goals.targets import frame_in_base, target_joints, target_pose
from stepbus_motion.ik.analytic import BranchSolver
from stepbus_motion.paths.spiral import SpiralMaker
from stepbus_motion.paths.trajectories import JointPath
from stepbus_schemas import BaseState, Goal


@dataclass(frozen=True, kw_only=True)
class Leg:
    """Joints to go to, shape (n,) [rad], and the paths of the tip that follow from there [m]."""

    target: Vector
    paths: tuple[JointPath, ...] = ()
    text: str = ""


class LegFinder:
    """Turns goals of types move_joints, move_to_pose and spiral into legs, the nearest first."""

    def __init__(self, robot: RobotModel, solver: BranchSolver, spirals: SpiralMaker) -> None:
        self._robot = robot
        self._solver = solver
        self._spirals = spirals
        self._kinds: dict[str, Callable[[Goal, Vector, Vector, BaseState], Iterator[Leg]]] = {
            "move_joints": self._joints,
            "move_to_pose": self._pose,
            "spiral": self._spiral,
        }

    def legs(self, goal: Goal, rest: Vector, q: Vector, base: BaseState) -> Iterator[Leg]:
        """Return what may be gone to from rest; q: measured, both of shape (n,) [rad].

        Raises Refused for another kind and, at the first leg, where nothing can be gone to;
        RunError for an unknown frame.
        """
        if goal.type not in self._kinds:
            raise Refused("invalid", f"an arm has no goals of type {goal.type}")
        return self._kinds[goal.type](goal, rest, q, base)

    def _joints(self, goal: Goal, rest: Vector, q: Vector, base: BaseState) -> Iterator[Leg]:
        target = target_joints(goal, self._robot, rest)
        load = self._robot.overload(target)
        if load is not None:
            raise Refused("not_holdable", f"not holdable: {load}")
        yield Leg(target=target)

    def _pose(self, goal: Goal, rest: Vector, q: Vector, base: BaseState) -> Iterator[Leg]:
        self._solver.chain(goal.tip)
        target = frame_in_base(self._robot, q, base, goal.frame) * target_pose(goal)
        ways = self._solver.solve(goal.tip, target, rest)
        for number, way in enumerate(ways, 1):
            yield Leg(target=way, text=f"way to stand {number} of {len(ways)}")

    def _spiral(self, goal: Goal, rest: Vector, q: Vector, base: BaseState) -> Iterator[Leg]:
        self._solver.chain(goal.tip)
        frame = frame_in_base(self._robot, q, base, goal.frame)
        for way in self._spirals.ways(goal, frame, frame * target_pose(goal), rest):
            yield Leg(target=way.start, paths=tuple(way.paths), text=way.text)
