"""The parameters of the controller of a mobile manipulator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_kinematics import RobotModel
from stepbus_motion.arm.settings import read_limits, read_robot, read_settling
from stepbus_motion.base.settings import BaseSettings
from stepbus_motion.collisions.monitor import MonitorSettings
from stepbus_motion.goals.avoidance import AvoidanceSettings
from stepbus_motion.goals.stow import StowCondition
from stepbus_motion.gripper.gripper import GripperSettings
from stepbus_motion.manipulator.options import ManipulatorOptions
from stepbus_motion.manipulator.settling import Settling
from stepbus_motion.motions.joint_motion import MotionLimits
from stepbus_participant import Config
from stepbus_participant.settings import Settings, nearest
from stepbus_schemas import RunError


@dataclass(frozen=True, kw_only=True)
class MobilePorts:
    """Names of the ports; those that may be None are left out by some scenarios."""

    joint_state: str
    odometry: str
    gripper_state: str
    goal: str
    contacts: str | None
    plan: str | None
    arm: str
    base: str
    gripper: str
    goal_status: str
    plan_request: str | None
    status: str | None


@dataclass(frozen=True, kw_only=True)
class MobileSettings:
    """What a scenario says about a `MobileController`.

    limits: of the arm's joints. monitor: None: nobody senses contacts.
    """

    ports: MobilePorts
    robot: RobotModel
    limits: MotionLimits
    settling: Settling
    arm: ManipulatorOptions
    base: BaseSettings
    gripper: GripperSettings
    stow: StowCondition
    monitor: MonitorSettings | None
    avoidance: AvoidanceSettings


def read_mobile_settings(config: Config) -> MobileSettings:
    """Return what the scenario says; lengths in [m], angles in [rad], times in [s].

    The arm: model (URDF or xacro, with the base's origin on the floor as its root), joints,
    velocity_limit (default: 80 % of the URDF's), acceleration_limit, jerk_limit, settle_*: as in
    `read_arm_settings`. tip, tip_velocity, tip_acceleration, tip_jerk, tip_turning, plan_timeout:
    see `ManipulatorOptions`. The base: base_speed, base_acceleration, base_jerk, base_turn_speed,
    base_turn_acceleration, base_turn_jerk, base_position, base_angle, base_timeout, base_lag,
    base_lag_angle, track: see `BaseSettings`; safe_height, safe_reach of the tip while it moves.
    The gripper: gripper_widest, gripper_tolerance, gripper_force (before the first goal). The
    monitor: robot_links (default: all of the model), pads, ignore (default: links of the model
    with wheel or caster in their names), collision_force [N], slow_within, slowest (share of the
    full speed), back_off, stop_within, replans: see `AvoidanceSettings`.
    Raises WiringError with all that is wrong.
    """
    settings = Settings(config)
    ports = _read_ports(settings, config)
    robot = read_robot(settings)
    limits = read_limits(settings, robot, acceleration=2.0, jerk=20.0)
    settling = read_settling(settings)
    arm = _read_arm(settings, config)
    base = _read_base(settings)
    gripper = _read_gripper(settings)
    height = settings.number("safe_height", 1.0, bound="positive")
    reach = settings.number("safe_reach", 0.9, bound="positive")
    monitor = _read_monitor(settings, robot)
    avoidance = _read_avoidance(settings)
    _check_frame(settings, "tip", arm.tip, robot)
    settings.check()
    if robot is None:
        settings.refuse()
    stow = StowCondition(robot=robot, frame=arm.tip, height=height, reach=reach)
    return MobileSettings(
        ports=ports,
        robot=robot,
        limits=limits,
        settling=settling,
        arm=arm,
        base=base,
        gripper=gripper,
        stow=stow,
        monitor=monitor if ports.contacts is not None else None,
        avoidance=avoidance,
    )


def _read_ports(settings: Settings, config: Config) -> MobilePorts:
    plan = _optional_input_of(settings, config, "Plan/1")
    request = settings.optional_output_of("PlanRequest/1")
    if (plan is None) != (request is None):
        problem = "a planner needs an input of type Plan/1 and an output of type PlanRequest/1"
        settings.note_all([f"participants.{config.name}: {problem}; wire both, or none of them"])
    ports = MobilePorts(
        joint_state=settings.input_of("JointState/1"),
        odometry=settings.input_of("BaseState/1"),
        gripper_state=settings.input_of("GripperState/1"),
        goal=settings.input_of("Goal/1"),
        contacts=_optional_input_of(settings, config, "Contacts/1"),
        plan=plan,
        arm=settings.output_of("JointCommand/1"),
        base=settings.output_of("BaseCommand/1"),
        gripper=settings.output_of("GripperCommand/1"),
        goal_status=settings.output_of("GoalStatus/1"),
        plan_request=request,
        status=settings.optional_output_of("ControllerStatus/1"),
    )
    settings.outputs_are(
        "JointCommand/1", "BaseCommand/1", "GripperCommand/1", "GoalStatus/1", "PlanRequest/1",
        "ControllerStatus/1",
    )  # fmt: skip
    return ports


def _optional_input_of(settings: Settings, config: Config, kind: str) -> str | None:
    if any(port.type == kind for port in config.inputs.values()):
        return settings.input_of(kind)
    return None


def _read_arm(settings: Settings, config: Config) -> ManipulatorOptions:
    names = ("tip_velocity", "tip_acceleration", "tip_jerk", "tip_turning", "plan_timeout")
    usual = ManipulatorOptions(period=config.every * config.step_ns * 1e-9, tip="grasp")
    given: dict[str, Any] = {
        name: settings.number(name, getattr(usual, name), bound="positive") for name in names
    }
    tip = str(settings.value("tip", usual.tip))
    return ManipulatorOptions(period=usual.period, tip=tip, **given)


def _read_base(settings: Settings) -> BaseSettings:
    names = (
        "speed", "acceleration", "jerk", "turn_speed", "turn_acceleration", "turn_jerk",
        "position", "angle", "timeout", "lag", "lag_angle",
    )  # fmt: skip
    usual = BaseSettings()
    given: dict[str, Any] = {
        name: settings.number(f"base_{name}", getattr(usual, name), bound="positive")
        for name in names
    }
    track = settings.number("track", usual.track, bound="positive")
    return BaseSettings(track=track, **given)


def _read_gripper(settings: Settings) -> GripperSettings:
    usual = GripperSettings()
    return GripperSettings(
        widest=settings.number("gripper_widest", usual.widest, bound="positive"),
        tolerance=settings.number("gripper_tolerance", usual.tolerance, bound="positive"),
        hold_force=settings.number("gripper_force", usual.hold_force, bound="not negative"),
    )


def _read_monitor(settings: Settings, robot: RobotModel | None) -> MonitorSettings:
    links = _links(robot)
    wheels = tuple(name for name in links if "wheel" in name or "caster" in name)
    ours = _names(settings, "robot_links", links)
    pads = _names(settings, "pads", ("left_pad", "right_pad"))
    ignore = _names(settings, "ignore", wheels)
    if len(pads) != 2:
        settings.note("pads", f"names {len(pads)} links; a gripper here has two")
        pads = ("", "")
    for param, names in (("robot_links", ours), ("pads", pads), ("ignore", ignore)):
        for name in names:
            if robot is not None and name and name not in links:
                settings.note(param, f"link {name!r} is not in the model; {nearest(name, links)}")
    slowest = settings.number("slowest", 0.2, bound="positive")
    if slowest > 1.0:
        settings.note("slowest", f"is {slowest:g}, a share of the full speed is at most 1")
    return MonitorSettings(
        links=frozenset(ours),
        base_links=frozenset(_base_links(robot)),
        pads=(pads[0], pads[1]),
        ignore=frozenset(ignore),
        force=settings.number("collision_force", 0.5, bound="positive"),
        within=settings.number("slow_within", 0.08, bound="positive"),
        slowest=slowest,
    )


def _read_avoidance(settings: Settings) -> AvoidanceSettings:
    usual = AvoidanceSettings()
    replans = settings.number("replans", usual.replans, bound="not negative")
    if replans != int(replans):
        settings.note("replans", f"is {replans:g}, not a whole number")
    return AvoidanceSettings(
        back_off=settings.number("back_off", usual.back_off, bound="not negative"),
        stop_within=settings.number("stop_within", usual.stop_within, bound="not negative"),
        replans=int(replans),
    )


def _names(settings: Settings, param: str, default: tuple[str, ...]) -> tuple[str, ...]:
    if settings.has(param):
        return settings.names(param)
    settings.value(param, list(default))
    return default


def _links(robot: RobotModel | None) -> tuple[str, ...]:
    """Return the names of all links of a robot, in the order of its model."""
    if robot is None:
        return ()
    return robot.links


def _base_links(robot: RobotModel | None) -> tuple[str, ...]:
    """Return the names of those links that no joint of the arm moves."""
    if robot is None:
        return ()
    return tuple(name for name in _links(robot) if not robot.chain(name).size)


def _check_frame(settings: Settings, param: str, frame: str, robot: RobotModel | None) -> None:
    if robot is None:
        return
    try:
        robot.frame_id(frame)
    except RunError as exc:
        settings.note(param, str(exc))
        return
    still = np.zeros(len(robot.joints))
    if not math.isfinite(float(robot.frame_pose(still, frame).translation[2])):
        settings.note(param, f"{frame!r} has no place in the model")
    elif not robot.chain(frame).size:
        settings.note(param, f"no joint of this controller moves {frame!r}")
