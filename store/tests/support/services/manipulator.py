"""A UR5 that carries out goals, without a bus: by itself, or in the plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel
from stepbus_participant import package_path
from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_schemas import BaseState, Goal, JointCommand, Plan, PlanRequest
from stepbus_store.motion.joint_motion import ManipulatorOptions, MotionLimits
from stepbus_store.motion.joint_params import JointParams
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.outcome import Measured, Outcome

JOINTS = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip
HOME = np.array([0.0, -1.2, 1.6, -2.0, -np.pi / 2, 0.0])
"""The tip looks down, 0.61 m ahead and 0.25 m up."""

DOWN = pin.SE3(np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]), np.zeros(3))
URL = "package://example-robot-data/robots/ur_description/urdf/ur5_robot.urdf"
UR5 = package_path(URL)
PERIOD = 0.008
STANDING = BaseState(x=0.0, y=0.0, yaw=0.0, vx=0.0, wz=0.0)

Answer = Callable[[PlanRequest], Plan | None]


def make_robot(path: Path = UR5) -> RobotModel:
    return RobotModel(path, JOINTS)


def with_effort(robot: RobotModel, limit: Any) -> RobotModel:
    """Return the robot with other motors; limit: shape (n,) [N·m]."""
    robot.effort_limit = np.array(limit, dtype=np.float64)
    return robot


def make_limits(robot: RobotModel) -> MotionLimits:
    one = np.ones(len(robot.joints))
    return MotionLimits(velocity=0.8 * robot.velocity_limit, acceleration=4 * one, jerk=40 * one)


def make_arm(
    robot: RobotModel, *, uses_planner: bool = False, settle_timeout: float = 0.5, **options: Any
) -> Manipulator:
    settling = JointParams(model=Path(), joints=(), settle_timeout=settle_timeout)
    given = ManipulatorOptions(**{"period": PERIOD, "tip": "tool0", **options})
    arm = Manipulator(robot, make_limits(robot), settling, given, seed=0, uses_planner=uses_planner)
    arm.hold(HOME)
    return arm


def pose_goal(kind: str, position: Any, rotation: Any = DOWN.rotation, **fields: Any) -> Goal:
    turn = pin.Quaternion(np.array(rotation))
    return Goal(
        id=0,
        type=kind,  # type: ignore[arg-type]
        position=tuple(float(x) for x in position),  # type: ignore[arg-type]
        **{"tip": "tool0", "orientation": (turn.x, turn.y, turn.z, turn.w), **fields},
    )


@dataclass
class Log:
    """What was commanded in each step, and how it ended."""

    q: list[Any] = field(default_factory=list)
    v: list[Any] = field(default_factory=list)
    measured: list[Any] = field(default_factory=list)
    outcome: Outcome | None = None

    @property
    def steps(self) -> int:
        return len(self.q)

    def speed(self) -> Any:
        return np.diff(np.array(self.q), axis=0) / PERIOD

    def push(self) -> Any:
        return np.diff(np.array(self.q), n=2, axis=0) / PERIOD**2


class Stage:
    """Steps an arm; joints follow their commands exactly, or as `motor` makes them.

    motor: takes position and velocity, returns position and velocity one period later.
    answer: a planner; its plans come back a step later.
    """

    def __init__(self, arm: Manipulator, motor: Any = None, answer: Answer | None = None) -> None:
        self.arm, self.t = arm, 0.0
        self.q, self.v = HOME, np.zeros(6)
        self._motor = motor or (lambda q, v: (q + v * PERIOD, v))
        self._answer = answer
        self._plan: Plan | None = None
        self.requests: list[PlanRequest] = []

    def start(self, goal: Goal, base: BaseState = STANDING, held: str = "") -> str:
        now = Measured(q=self.q, v=self.v, base=base)
        return self.arm.start(goal, now, self.t, held=held)

    def step(self, log: Log, scale: float = 1.0) -> None:
        if self._plan is not None:
            self.arm.take_plan(self._plan, self.t)
            self._plan = None
        log.outcome = self.arm.check(self.q, self.v, self.t)
        request = self.arm.queries.pop()
        if request is not None:
            self.requests.append(request)
            self._plan = self._answer(request) if self._answer else None
        now = self.arm.at(self.t)
        log.q.append(now.position)
        log.v.append(now.velocity)
        log.measured.append(self.q)
        self.q, self.v = self._motor(now.position, now.velocity)
        self.arm.advance(PERIOD, scale)
        self.t += PERIOD

    def run(self, goal: Goal | None = None, *, steps: int = 5000, **begin: Any) -> Log:
        """Return what happens until the goal ends, or for so many steps."""
        if goal is not None:
            self.start(goal, **begin)
        log = Log()
        while log.outcome is None and log.steps < steps:
            self.step(log)
        return log


class PlantMotor:
    """The plant's UR5 on a fixed base, driven by position and velocity as over the bus."""

    def __init__(self, folder: Path, urdf: str = URL) -> None:
        rows = ", ".join(
            f"{n}: {{position: {q!r}}}" for n, q in zip(JOINTS, HOME.tolist(), strict=True)
        )
        path = folder / "world.yaml"
        path.write_text(
            f"physics_step: 4ms\nbodies:\n  arm: {{urdf: {urdf}, fixed_base: true, "
            f"visuals: false, joint_defaults: {{mode: position}}, joints: {{{rows}}}}}\n"
        )
        params = Params(world=path.name, joints=JOINTS)
        self._plant = SimulatedPlant(load_world(path), params, 8_000_000, 0)
        self._commander = self._plant.commander("command", JOINTS)

    def __call__(self, q: Any, v: Any) -> tuple[Any, Any]:
        command = JointCommand(mode="position", values=q.tolist(), velocity=v.tolist())
        self._commander.apply(command)
        self._plant.advance()
        state = self._plant.sense()
        return np.array(state.position), np.array(state.velocity)
