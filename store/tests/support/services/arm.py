"""A planar arm of three joints, and goals carried out on it without a bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stepbus_kinematics import RobotModel
from stepbus_schemas import Goal, GoalStatus
from stepbus_store.motion.executor import GoalExecutor
from stepbus_store.motion.ik_search import InverseKinematics
from stepbus_store.motion.joint_motion import JointMotion, ManipulatorOptions, MotionLimits
from stepbus_store.motion.joint_params import JointParams
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.outcome import Measured
from stepbus_store.motion.parts import Parts

JOINTS = ("one", "two", "three")
PERIOD = 0.05
_LINK = """
  <link name="link_{n}"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="{name}" type="revolute"><parent link="{parent}"/><child link="link_{n}"/>
    <origin xyz="{x} 0 0"/><axis xyz="{axis}"/>
    <limit lower="-2.5" upper="2.5" effort="{effort}" velocity="2"/></joint>"""


def write_arm(folder: Path, effort: float = 100.0, axes: tuple[str, ...] = ("0 1 0",) * 3) -> Path:
    """Return a URDF of three links of 1 m and 1 kg, and a hand at their end."""
    rows = [
        _LINK.format(n=n, name=name, parent=f"link_{n - 1}", x=min(n, 1), axis=axis, effort=effort)
        for n, (name, axis) in enumerate(zip(JOINTS, axes, strict=True))
    ]
    rows[0] = rows[0].replace("link_-1", "base")
    text = (
        '<robot name="arm"><link name="base"/>'
        + "".join(rows)
        + (
            '<link name="hand"/><joint name="wrist" type="fixed"><parent link="link_2"/>'
            '<child link="hand"/><origin xyz="1 0 0"/></joint></robot>'
        )
    )
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


def make_ik(robot: RobotModel, seed: int = 0, **settings: Any) -> InverseKinematics:
    return InverseKinematics(robot, seed=seed, **settings)


class Runner:
    """A goal executor of an arm alone, with what it was given and what it reports."""

    def __init__(self, robot: RobotModel, *, tries_unholdable: bool = False) -> None:
        one = np.ones(len(robot.joints))
        limits = MotionLimits(velocity=2 * one, acceleration=4 * one, jerk=40 * one)
        settling = JointParams(model=Path(), joints=(), settle_steps=3, settle_timeout=0.5)
        options = ManipulatorOptions(period=PERIOD, tip="", effort_share=1.0)
        self.arm = Manipulator(
            robot, limits, settling, options, seed=0, tries_unholdable=tries_unholdable
        )
        self._executor = GoalExecutor(Parts(arm=self.arm))
        rest = np.array([0.5, 0.5, 0.5])
        self._executor.hold(Measured(q=rest, v=0 * rest))

    def start(self, goal: Goal, t: float) -> None:
        self._executor.start(goal, t)

    def at(self, t: float) -> JointMotion:
        return self.arm.at(t)

    def carry_on(self, t: float, seconds: float = 8.0, stuck: bool = False) -> None:
        """Let perfect motors follow, or none, for some time [s]."""
        start = self.at(t)
        for now_s in np.arange(t, t + seconds, PERIOD):
            now = start if stuck else self.at(now_s)
            measured = Measured(q=now.position, v=now.velocity * (not stuck))
            self._executor.check(measured, now_s, PERIOD)

    def statuses(self) -> list[GoalStatus]:
        """Return what was reported since the last call."""
        return list(iter(self._executor.reports.next_status, None))
