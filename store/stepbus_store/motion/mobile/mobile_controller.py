"""Carries out goals of an arm on a mobile base with a gripper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import msgspec

from stepbus_participant import Config, Participant, Step, installed_version
from stepbus_schemas import (
    BaseState,
    Contacts,
    Description,
    EmergencyStop,
    Goal,
    GripperState,
    JointState,
    Message,
    Plan,
    PlanRequest,
    RunError,
)
from stepbus_store.cause import Cause
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.executor import GoalExecutor
from stepbus_store.motion.gripper import Gripper, Scale
from stepbus_store.motion.manipulator.settings import make_manipulator
from stepbus_store.motion.mobile.mobile_settings import MobileSettings
from stepbus_store.motion.monitor import CollisionMonitor
from stepbus_store.motion.navigator import Navigator
from stepbus_store.motion.outcome import JointSensor, Measured
from stepbus_store.motion.parts import Parts


class MobileController(Participant):
    """Carries out the goals of an arm on a mobile base with a gripper, one at a time.

    Inputs: one JointState/1, BaseState/1, GripperState/1, Goal/1. Optional inputs: one Contacts/1,
    to monitor the robot for collisions; one Plan/1 of a planner; and one EmergencyStop/1: while it
    is active, all goals fail, and the controller sends no commands.
    Outputs: one JointCommand/1 of mode position with feed-forward velocity, one BaseCommand/1 and
    one GripperCommand/1 at every step; one GoalStatus/1 whenever the status changes; one
    PlanRequest/1 for the planner; optionally, one ControllerStatus/1.

    A goal starts when its id differs from the previous one. Parameters: see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.settings = MobileSettings(config)
        self._ports = self.settings.ports
        self._period = config.every * config.step_ns * 1e-9
        self._is_held = False
        self._goal_id = -1

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of commands and plans."""
        settings = self.settings
        names = [settings.params.prefix + joint for joint in settings.robot.joints]
        ports = (self._ports.arm, self._ports.plan_request, self._ports.status)
        return {port: Description(names=names) for port in ports if port is not None}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints by name and take the plant's effort limits.

        Raises WiringError for joints that the plant does not sense.
        """
        settings, port = self.settings, self._ports.joint_state
        self._sensor = JointSensor(
            port, inputs[port], settings.robot, period=self._period, prefix=settings.params.prefix
        )
        self._arm = make_manipulator(
            settings.robot,
            settings.limits,
            settings.params,
            settings.arm,
            seed=self.config.seed,
            uses_planner=self._ports.plan is not None,
            collisions=settings.collisions,
        )
        self._base, self._gripper = BaseMotion(settings.params), Gripper(settings.params)
        self._navigator: Navigator | None = None
        if self._ports.plan is not None:
            self._navigator = Navigator(
                self._base,
                self._arm.queries.next_id,
                settings.arm.plan_timeout,
                settings.params.base_step,
            )
        self._executor = GoalExecutor(
            Parts(
                arm=self._arm,
                base=self._base,
                navigator=self._navigator,
                gripper=self._gripper,
                stow=settings.stow,
                scale=Scale(settings.robot, settings.arm.tip),
            ),
            CollisionMonitor(settings.monitor) if settings.monitor is not None else None,
        )

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the commands of this step, and what is new about the goal."""
        now = self._sense(step)
        if now is None:
            return {}
        is_first, self._is_held = not self._is_held, True
        stop = step.get(self._ports.stop, EmergencyStop) if self._ports.stop else None
        is_stopped = stop is not None and stop.active
        if is_first:
            self._executor.hold(now)
        if is_stopped:
            self._executor.interrupt(now, str(stop), self._period)
        elif not is_first:
            self._executor.check(now, step.t, self._period)
        self._take_plan(step)
        goal = step.get(self._ports.goal, Goal)
        if goal is not None and goal.id != self._goal_id:
            self._goal_id = goal.id
            self._executor.start(goal, step.t)
        return self._messages(step, now, is_stopped=is_stopped)

    def _sense(self, step: Step) -> Measured | None:
        """Return the measurements of this step; None: some inputs have not come yet."""
        ports = self._ports
        joints = step.get(ports.joint_state, JointState)
        base = step.get(ports.odometry, BaseState)
        gripper = step.get(ports.gripper_state, GripperState)
        if joints is None or base is None or gripper is None:
            return None
        arm = self._sensor.read(joints)
        contacts = step.get(ports.contacts, Contacts) if ports.contacts is not None else None
        prefix = self.settings.params.prefix
        if contacts is not None and prefix:
            # The robot's own links have the names of its model.
            pairs = [(a.removeprefix(prefix), b.removeprefix(prefix)) for a, b in contacts.pairs]
            contacts = msgspec.structs.replace(contacts, pairs=pairs)
        _check(arm, base, gripper)
        return replace(arm, base=base, gripper=gripper, contacts=contacts)

    def _take_plan(self, step: Step) -> None:
        if self._ports.plan is None or not step.is_new(self._ports.plan):
            return
        plan = step.read(self._ports.plan, Plan)
        if plan.cause == Cause.PLANNER_FAILED:
            self._executor.lose_planner(plan.text, step.t)
        else:
            self._arm.take_plan(plan, step.t)
            if self._navigator is not None:
                self._navigator.take_plan(plan)

    def _messages(self, step: Step, now: Measured, *, is_stopped: bool) -> dict[str, Message]:
        ports, target = self._ports, self._arm.at(step.t)
        messages: dict[str, Message] = {}
        if not is_stopped:
            messages = {
                ports.arm: target.command(),
                ports.base: self._base.command(),
                ports.gripper: self._gripper.command(),
            }
        status = self._executor.reports.next_status()
        if status is not None:
            messages[ports.goal_status] = status
        request = self._request()
        if request is not None and ports.plan_request is not None:
            messages[ports.plan_request] = request
        if ports.status is not None:
            error = target.position - now.q
            messages[ports.status] = self._executor.reports.controller_status(error)
        return messages

    def _request(self) -> PlanRequest | None:
        """Return the next request; the planner cancels the previous one when it comes."""
        queries, navigator = self._arm.queries, self._navigator
        if navigator is None:
            return queries.pop()
        request = None if navigator.awaits_route else queries.pop()
        return navigator.pop() if request is None and queries.search is None else request

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the motion."""
        return {name: installed_version(name) for name in ("numpy", "pin", "ruckig")}


def _check(arm: Measured, base: BaseState, gripper: GripperState) -> None:
    """Raise RunError for a measurement that is no finite number."""
    rows = {
        "the joints": (
            *arm.q.tolist(),
            *arm.v.tolist(),
            *(() if arm.effort is None else arm.effort.tolist()),
        ),
        "the base": (base.x, base.y, base.yaw, base.vx, base.wz),
        "the gripper": (gripper.width, gripper.force, gripper.slip),
    }
    for name, row in rows.items():
        if not math.isfinite(sum(row)):
            raise RunError(f"the measurements of {name} are not finite: {list(row)}")
