"""From a goal to joint targets: judge, plan, carry out, wait until the joints are still."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Indices, RobotModel, Vector
from stepbus_motion.ik.search import InverseKinematics, Solution
from stepbus_motion.manipulator.detours import Planner
from stepbus_motion.paths.motion import JointMotion, MotionLimits, Route, stop_from
from stepbus_participant.settings import nearest
from stepbus_schemas import Goal, GoalStatus, RunError
from stepbus_schemas.messages import GoalState

from .outcome import Refused, Settling


@dataclass(kw_only=True)
class _Task:
    """The goal under way: its route, when it began [s], and for how many steps it has settled.

    moved: places of the joints that it moves.
    """

    id: int
    route: Route
    moved: Indices
    began: float
    settled: int = 0
    told: bool = False


class GoalRunner:
    """Carries out one goal at a time; a new one ends the one before.

    limits: of the motion. tries_unholdable: whether poses that the motors cannot hold are gone to
    all the same, after saying so.
    """

    def __init__(
        self,
        robot: RobotModel,
        ik: InverseKinematics,
        planner: Planner,
        limits: MotionLimits,
        settling: Settling,
        *,
        tries_unholdable: bool = False,
    ) -> None:
        self._robot = robot
        self._ik = ik
        self._planner = planner
        self._limits = limits
        self._settling = settling
        self._tries_unholdable = tries_unholdable
        self._news: deque[GoalStatus] = deque()
        self._task: _Task | None = None
        self._rest: JointMotion | None = None
        self._kinds: dict[str, Callable[[Goal, Vector], Solution]] = {
            "move_joints": self._solve_joints,
            "move_to_pose": self._solve_pose,
        }

    def hold(self, q: Vector) -> None:
        """Stand still at q, shape (n,) [rad]: where the joints are when it all begins."""
        self._rest = JointMotion.at_rest(q)

    def at(self, t: float) -> JointMotion:
        """Return where the joints shall be at a time [s]."""
        if self._task is not None:
            return self._task.route.at(t - self._task.began)
        if self._rest is None:
            raise RunError("the joints have not been measured yet")
        return self._rest

    def news(self) -> GoalStatus | None:
        """Return the next status nobody has been told of, if there is one."""
        return self._news.popleft() if self._news else None

    def begin(self, goal: Goal, t: float) -> None:
        """Take in a goal; what is wrong with it becomes its status."""
        now = self.at(t)
        if self._task is not None:
            text = f"goal {goal.id} came before it was done"
            self._tell(self._task.id, "cancelled", text=text)
        try:
            route = self._route(goal, now)
        except Refused as exc:
            self._tell(goal.id, "failed", exc.cause, str(exc))
            self._stop(goal, now, t)
            return
        self._task = self._task_of(goal.id, route, t)

    def _stop(self, goal: Goal, now: JointMotion, t: float) -> None:
        """Come to rest, where a motion was under way."""
        if self._task is not None:
            route = Route([stop_from(now, self._limits)])
            self._task = self._task_of(-1 - goal.id, route, t)

    def _task_of(self, number: int, route: Route, t: float) -> _Task:
        way = route.at(route.duration).position - route.at(0.0).position
        moved = np.flatnonzero(way) if way.any() else np.arange(len(way))
        return _Task(id=number, route=route, began=t, moved=moved)

    def _route(self, goal: Goal, now: JointMotion) -> Route:
        if goal.type == "stop":
            self._tell(goal.id, "accepted", text="stop")
            return Route([stop_from(now, self._limits)])
        if not (math.isfinite(goal.duration) and goal.duration >= 0):
            raise Refused("invalid", f"duration {goal.duration:g} s is no length of time")
        solution = self._kinds[goal.type](goal, now.position)
        overloaded = solution.verdict == "not_holdable"
        if solution.verdict != "reached" and not (overloaded and self._tries_unholdable):
            raise Refused(solution.verdict, str(solution))
        try:
            motions = self._planner.plan(now, solution.q, goal.duration, holds=not overloaded)
        except RunError as exc:
            raise Refused("no_way", str(exc)) from exc
        if motions is None:
            raise Refused("no_way", "no motion was found that neither touches nor overloads")
        route = Route(motions)
        text = f"{solution}; {route.duration:.2f} s of motion in {len(motions)} parts"
        self._tell(goal.id, "accepted", solution.verdict if overloaded else "", text)
        return route

    def _solve_joints(self, goal: Goal, q: Vector) -> Solution:
        robot, target = self._robot, q.copy()
        if len(goal.joints) != len(goal.values) or not goal.joints:
            counts = f"{len(goal.values)} values for {len(goal.joints)} joints"
            raise Refused("invalid", f"type move_joints has {counts}")
        for name, value in zip(goal.joints, goal.values, strict=True):
            if name not in robot.joints:
                raise Refused("invalid", f"joint {name!r}: {nearest(name, robot.joints)}")
            place = robot.joints.index(name)
            low, high = robot.lower[place], robot.upper[place]
            if not low <= value <= high:
                text = f"{name} shall go to {value:g} rad, its limits are [{low:g}, {high:g}]"
                raise Refused("invalid", text)
            target[place] = value
        places = [robot.joints.index(name) for name in goal.joints]
        return self._ik.judge(target, np.array(places, dtype=np.intp))

    def _solve_pose(self, goal: Goal, q: Vector) -> Solution:
        try:
            moves = bool(self._robot.chain(goal.tip).size)
            base = self._robot.frame_pose(q, goal.frame)
        except RunError as exc:
            raise Refused("invalid", str(exc)) from exc
        if not moves:
            raise Refused("invalid", f"no joint of this controller moves tip {goal.tip!r}")
        target = base * _pose(goal)
        return self._ik.solve(goal.tip, target, q)

    def look(self, q: Vector, v: Vector, t: float) -> None:
        """Take in measured positions and velocities, shape (n,) [rad, rad/s], at a time [s]."""
        task = self._task
        if task is None:
            return
        if not task.told:
            task.told = True
            self._tell(task.id, "running")
        late = t - task.began - task.route.duration
        if late < 0:
            return
        error = (task.route.at(task.route.duration).position - q)[task.moved]
        speed = np.abs(v[task.moved]).max()
        still = self._settling
        is_there = np.abs(error).max() <= still.position and speed <= still.velocity
        task.settled = task.settled + 1 if is_there else 0
        worst = int(np.argmax(np.abs(error)))
        off = f"{self._robot.joints[task.moved[worst]]} is {math.degrees(error[worst]):.3f}° off"
        if task.settled >= still.steps:
            self._rest = task.route.at(task.route.duration)
            self._end(task.id, "succeeded", text=f"settled {late:.2f} s after the motion; {off}")
        elif late >= still.timeout:
            # A target out of reach is given up: the next motion begins where the joints are.
            self.hold(np.clip(q, self._robot.lower, self._robot.upper))
            text = f"not settled {late:.2f} s after the motion: {off}"
            self._end(task.id, "failed", "not_settled", text)

    def _end(self, number: int, state: GoalState, cause: str = "", text: str = "") -> None:
        self._tell(number, state, cause, text)
        self._task = None

    def _tell(self, number: int, state: GoalState, cause: str = "", text: str = "") -> None:
        # A negative number is a stop of our own, after a goal that was refused: nobody asked.
        if number >= 0:
            self._news.append(GoalStatus(id=number, state=state, cause=cause, text=text))


def _pose(goal: Goal) -> Any:
    """Return the pose of a goal as `pinocchio.SE3`.

    Raises Refused where it is none.
    """
    if goal.position is None or goal.orientation is None:
        raise Refused("invalid", "type move_to_pose needs position and orientation")
    length = math.hypot(*goal.orientation)
    if not math.isfinite(sum(goal.position)) or not abs(length - 1.0) <= 1e-3:
        text = f"position {goal.position} or orientation {goal.orientation} is no pose"
        raise Refused("invalid", f"{text}; the quaternion x, y, z, w has length {length:g}, not 1")
    turn = pin.Quaternion(np.array(goal.orientation) / length)
    return pin.SE3(turn.matrix(), np.array(goal.position))
