"""Carries out goals of an arm on a mobile base with a gripper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import msgspec

from stepbus_kinematics import RobotModel
from stepbus_participant import Config, Ports, Problems, Step, installed_version, suggest
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
from stepbus_store.memory import Remembering
from stepbus_store.motion.back_to_rest import check_stowed
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.executor import GoalExecutor
from stepbus_store.motion.gripper import Gripper, Scale
from stepbus_store.motion.joint_motion import ManipulatorOptions
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.manipulator_setup import make_collisions, make_limits, make_robot
from stepbus_store.motion.mobile.params import Params
from stepbus_store.motion.monitor import CollisionMonitor
from stepbus_store.motion.navigator import Navigator
from stepbus_store.motion.outcome import JointSensor, Measured
from stepbus_store.motion.parts import Parts


class _Ports:
    """Names of the ports, found by their types; some scenarios leave out those that may be None.

    Problems are added to `ports`.
    """

    def __init__(self, ports: Ports) -> None:
        self.plan = ports.optional_input_of("Plan/1")
        self.plan_request = ports.optional_output_of("PlanRequest/1")
        if (self.plan is None) != (self.plan_request is None):
            text = "a planner needs an input of type Plan/1 and an output of type PlanRequest/1"
            ports.problems.add((), f"{text}; connect both or neither")
        self.joint_state = ports.input_of("JointState/1")
        self.odometry = ports.input_of("BaseState/1")
        self.gripper_state = ports.input_of("GripperState/1")
        self.goal = ports.input_of("Goal/1")
        self.contacts = ports.optional_input_of("Contacts/1")
        self.stop = ports.optional_input_of("EmergencyStop/1")
        self.arm = ports.output_of("JointCommand/1")
        self.base = ports.output_of("BaseCommand/1")
        self.gripper = ports.output_of("GripperCommand/1")
        self.goal_status = ports.output_of("GoalStatus/1")
        self.status = ports.optional_output_of("ControllerStatus/1")
        ports.outputs_are(
            "JointCommand/1", "BaseCommand/1", "GripperCommand/1", "GoalStatus/1", "PlanRequest/1",
            "ControllerStatus/1",
        )  # fmt: skip


_PLANNED_JERK = 0.9
"""Share of the jerk limit that a motion uses: slowed down near things, it has 1.1 times as much."""


class MobileController(Remembering):
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
        ports = Ports(config)
        self._ports = _Ports(ports)
        params = self._params = config.read(Params, ports.problems)
        problems = config.problems().below(("params",))
        self.robot = robot = make_robot(params, problems, params.posture)
        self._monitor = _monitor(params, robot, problems)
        srdf, margin = params.srdf, params.collision_margin
        self._collisions = make_collisions(robot, srdf, margin, problems)
        problems.refuse()
        self._period = config.every * config.step_ns * 1e-9
        self._is_held = False

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of commands and plans."""
        names = [self._params.prefix + joint for joint in self.robot.joints]
        ports = (self._ports.arm, self._ports.plan_request, self._ports.status)
        return {port: Description(names=names) for port in ports if port is not None}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Put the arm together; raises WiringError for joints that the plant does not sense."""
        params, robot, port = self._params, self.robot, self._ports.joint_state
        has_planner = self._ports.plan is not None
        self._sensor = JointSensor(
            port, inputs[port], robot, period=self._period, prefix=params.prefix
        )
        limits = make_limits(params, robot, params.acceleration_limit, params.jerk_limit)
        self._arm = arm = Manipulator(
            robot,
            replace(limits, jerk=_PLANNED_JERK * limits.jerk),
            params,
            ManipulatorOptions(
                period=self._period,
                tip=params.tip,
                tip_velocity=params.tip_velocity,
                tip_acceleration=params.tip_acceleration,
                tip_jerk=params.tip_jerk,
                plan_timeout=params.plan_timeout,
                jam_lag=params.arm_lag,
            ),
            seed=self.config.seed,
            uses_planner=has_planner,
            collisions=self._collisions,
        )
        self._base, self._gripper = BaseMotion(params), Gripper(params)
        self._navigator: Navigator | None = None
        if has_planner:
            self._navigator = Navigator(
                self._base, arm.queries.next_id, params.plan_timeout, params.base_step
            )
        self._executor = GoalExecutor(
            Parts(
                arm=arm,
                base=self._base,
                navigator=self._navigator,
                gripper=self._gripper,
                check_stowed=partial(check_stowed, robot, params),
                scale=Scale(robot, params.tip),
            ),
            self._monitor if self._ports.contacts is not None else None,
        )
        self.remember()

    def restore(self, state: bytes) -> None:
        """Restore what `save` returned, and the load that the arm carries."""
        super().restore(state)
        self.robot.carry(self._arm.queries.load, self._params.tip)

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
        self._executor.start(step.get(self._ports.goal, Goal), step.t)
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
        prefix = self._params.prefix
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
    joints = [*arm.q.tolist(), *arm.v.tolist()]
    if arm.effort is not None:
        joints += arm.effort.tolist()
    rows = {
        "the joints": joints,
        "the base": [base.x, base.y, base.yaw, base.vx, base.wz],
        "the gripper": [gripper.width, gripper.force, gripper.slip],
    }
    for name, row in rows.items():
        if not math.isfinite(sum(row)):
            raise RunError(f"the measurements of {name} are not finite: {row}")


def _monitor(params: Params, robot: RobotModel, problems: Problems) -> CollisionMonitor:
    links = robot.links
    wheels = tuple(name for name in links if "wheel" in name or "caster" in name)
    ignore = wheels if params.ignore is None else params.ignore
    for key, names in (("tip", (params.tip,)), ("pads", params.pads), ("ignore", ignore)):
        for name in names:
            if name not in links:
                problems.add((key,), f"link {name!r} is not in the model{suggest(name, links)}")
    if params.tip in links and not robot.chain(params.tip).size:
        problems.add(("tip",), f"no joint of this controller moves {params.tip!r}")
    return CollisionMonitor(
        params,
        links=frozenset(links),
        base_links=frozenset(name for name in links if not robot.chain(name).size),
        ignore=frozenset(ignore),
    )
