"""A controller of a mobile manipulator: `python -m stepbus_motion.mobile`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib.metadata import version

import numpy as np

from stepbus_kinematics import JointOrder
from stepbus_motion.base.motion import BaseMotion
from stepbus_motion.collisions.monitor import CollisionMonitor
from stepbus_motion.goals.executor import Dispatcher, Sensed
from stepbus_motion.gripper.gripper import Grip
from stepbus_motion.manipulator.manipulator import Manipulator
from stepbus_participant import Config, Participant, Step
from stepbus_schemas import (
    BaseState,
    Contacts,
    ControllerStatus,
    Description,
    Goal,
    GripperState,
    JointCommand,
    JointState,
    Message,
    Plan,
    RunError,
    WiringError,
)

from .settings import MobileSettings, read_mobile_settings

_PLANNER_FAILED = "planner_failed"
"""Cause of a plan that stepbus sends in a planner's stead, when that is `on_fault: hold`."""


class MobileController(Participant):
    """Carries out the goals of an arm on a mobile base with a gripper, one at a time.

    Inputs: one JointState/1, BaseState/1, GripperState/1, Goal/1; where the scenario wires them,
    one Contacts/1, with which collisions are watched, and one Plan/1 of a planner. Outputs: one
    JointCommand/1 of mode position with feed-forward velocity, one BaseCommand/1 and one
    GripperCommand/1 at every step; one GoalStatus/1 whenever there is news; one PlanRequest/1 for
    the planner; where it is wired, one ControllerStatus/1.

    A goal is taken in when its id differs from the one before. Parameters: see
    `read_mobile_settings`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._settings: MobileSettings = read_mobile_settings(config)
        self._ports = self._settings.ports
        self._period = config.every * config.step_ns * 1e-9
        self._sensed: Sensed | None = None
        self._goal_id = -1

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of commands and plans."""
        names = list(self._settings.robot.joints)
        ports = (self._ports.arm, self._ports.plan_request, self._ports.status)
        return {port: Description(names=names) for port in ports if port is not None}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints by name and take the plant's effort limits.

        Raises WiringError for joints that the plant does not sense.
        """
        settings, described = self._settings, inputs[self._ports.joint_state]
        joints = settings.robot.joints
        try:
            self._order = JointOrder(self._ports.joint_state, described.names, joints)
        except WiringError as exc:
            lines = [f"{self.config.name}: {line}" for line in str(exc).splitlines()]
            raise WiringError("\n".join(lines)) from exc
        effort = described.limits.get("effort")
        if effort is not None:
            settings.robot.effort_limit = self._order.pick(effort, "effort limits")
        self._start_parts(settings)

    def _start_parts(self, settings: MobileSettings) -> None:
        self._arm = Manipulator(
            settings.robot,
            settings.limits,
            settings.settling,
            settings.arm,
            seed=self.config.seed,
        )
        self._base, self._hand = BaseMotion(settings.base), Grip(settings.hand)
        self._dispatcher = Dispatcher(
            self._arm,
            self._base,
            self._hand,
            settings.travel,
            monitor=CollisionMonitor(settings.monitor) if settings.monitor is not None else None,
            evasion=settings.evasion,
        )

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the commands of this step, and what is new of the goal."""
        sensed = self._sense(step)
        if sensed is None:
            return {}
        if self._sensed is None:
            self._dispatcher.hold(sensed)
        else:
            self._dispatcher.look(sensed, step.t, self._period)
        self._sensed = sensed
        self._take_plan(step)
        goal = step.get(self._ports.goal, Goal)
        if goal is not None and goal.id != self._goal_id:
            self._goal_id = goal.id
            self._dispatcher.begin(goal, step.t)
        return self._messages(step, sensed)

    def _sense(self, step: Step) -> Sensed | None:
        """Return what was measured; None: not everything was measured yet."""
        ports = self._ports
        joints = step.get(ports.joint_state, JointState)
        base = step.get(ports.odometry, BaseState)
        hand = step.get(ports.hand_state, GripperState)
        if joints is None or base is None or hand is None:
            return None
        q = self._order.pick(joints.position, "position")
        if joints.velocity is not None:
            v = self._order.pick(joints.velocity, "velocity")
        elif self._sensed is not None:
            v = (q - self._sensed.q) / self._period
        else:
            v = np.zeros_like(q)
        contacts = step.get(ports.contacts, Contacts) if ports.contacts is not None else None
        sensed = Sensed(q=q, v=v, base=base, hand=hand, contacts=contacts)
        _check(sensed)
        return sensed

    def _take_plan(self, step: Step) -> None:
        if self._ports.plan is None or not step.is_new(self._ports.plan):
            return
        plan = step.read(self._ports.plan, Plan)
        if plan.cause == _PLANNER_FAILED:
            self._dispatcher.lose_planner(plan.text, step.t)
        else:
            self._arm.take_plan(plan, step.t)

    def _messages(self, step: Step, sensed: Sensed) -> dict[str, Message]:
        ports, target = self._ports, self._arm.at(step.t)
        messages: dict[str, Message] = {
            ports.arm: JointCommand(
                mode="position",
                values=target.position.tolist(),
                velocity=target.velocity.tolist(),
            ),
            ports.base: self._base.command(),
            ports.hand: self._hand.command(),
        }
        news = self._dispatcher.news()
        if news is not None:
            messages[ports.goal_status] = news
        request = self._arm.request()
        if request is not None and ports.plan_request is not None:
            messages[ports.plan_request] = request
        if ports.status is not None:
            error: list[float] = (target.position - sensed.q).tolist()
            messages[ports.status] = ControllerStatus(
                error=error,
                saturated=[False] * len(error),
                warnings=self._dispatcher.warnings(),
            )
        return messages

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the motion."""
        return {name: version(name) for name in ("numpy", "pin", "ruckig")}


def _check(sensed: Sensed) -> None:
    """Raise RunError for a measurement that is no finite number."""
    base, hand = sensed.base, sensed.hand
    rows = {
        "the joints": (*sensed.q.tolist(), *sensed.v.tolist()),
        "the base": (base.x, base.y, base.yaw, base.vx, base.wz),
        "the gripper": (hand.width, hand.force),
    }
    for name, row in rows.items():
        if not math.isfinite(sum(row)):
            raise RunError(f"what was measured of {name} are not finite numbers: {list(row)}")
