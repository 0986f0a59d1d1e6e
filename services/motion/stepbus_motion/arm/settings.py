"""The parameters of the controller that carries out goals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions, Smoother, read_smoother
from stepbus_motion.manipulator.settling import Settling
from stepbus_motion.motions.joint_motion import MotionLimits
from stepbus_participant.settings import Settings
from stepbus_schemas import WiringError


@dataclass(frozen=True, kw_only=True)
class ArmSettings:
    """What a scenario says about an `ArmController`.

    limits: of the joints.
    """

    robot: RobotModel
    collisions: SelfCollisions | None
    limits: MotionLimits
    settling: Settling
    tries_unholdable: bool
    smoother: Smoother | None


def read_arm_settings(settings: Settings, period: float) -> ArmSettings:
    """Return what the scenario's params say; period: between two measurements [s].

    model: URDF. joints: those to move, all others stand at neutral. srdf: with it, poses and
    motions that touch are refused; collision_margin [m]. velocity_limit (default: 80 % of the
    URDF's), acceleration_limit, jerk_limit: one number for all joints, a list, or a map by name
    [rad/s, rad/s², rad/s³]. settle_position [rad], settle_velocity [rad/s], settle_steps,
    settle_timeout [s]: when a motion counts as done. not_holdable: `refuse`, or `try` poses that
    the motors cannot hold. smoothing: see `read_smoother`.
    Raises WiringError with all that is wrong.
    """
    robot = read_robot(settings)
    collisions = _read_collisions(settings, robot)
    limits = read_limits(settings, robot, acceleration=4.0, jerk=40.0)
    settling = read_settling(settings)
    tries = settings.choice("not_holdable", ("refuse", "try"), default="refuse") == "try"
    smoother = read_smoother(settings, period)
    settings.check()
    if robot is None:
        settings.refuse()
    return ArmSettings(
        robot=robot,
        collisions=collisions,
        limits=limits,
        settling=settling,
        tries_unholdable=tries,
        smoother=smoother,
    )


def read_limits(
    settings: Settings, robot: RobotModel | None, *, acceleration: float, jerk: float
) -> MotionLimits:
    """Return the limits of the joints; acceleration, jerk: defaults [rad/s², rad/s³]."""
    return MotionLimits(
        velocity=np.array(_velocity_limit(settings, robot)),
        acceleration=np.array(_joint_limit(settings, robot, "acceleration_limit", acceleration)),
        jerk=np.array(_joint_limit(settings, robot, "jerk_limit", jerk)),
    )


def _velocity_limit(settings: Settings, robot: RobotModel | None) -> list[float]:
    """Return what `velocity_limit` says, or else 80 % of the URDF's limits, shape (n,) [rad/s]."""
    urdf = [0.8 * limit for limit in robot.velocity_limit] if robot is not None else []
    settings.value("velocity_limit", urdf)
    if robot is None or not settings.has("velocity_limit"):
        return urdf
    return settings.per_name("velocity_limit", robot.joints, bound="positive")


def _joint_limit(
    settings: Settings, robot: RobotModel | None, param: str, default: float
) -> list[float]:
    """Return a limit of each joint, shape (n,); empty for a robot that cannot be read."""
    if robot is None:
        settings.value(param, default)
        return []
    return settings.per_name(param, robot.joints, default, bound="positive")


def read_settling(settings: Settings) -> Settling:
    """Return what the parameters that begin with `settle_` say."""
    steps = settings.number("settle_steps", 5, bound="positive")
    if steps != int(steps):
        settings.note("settle_steps", f"is {steps:g}, not a whole number")
    return Settling(
        position=settings.number("settle_position", 1e-3, bound="positive"),
        velocity=settings.number("settle_velocity", 1e-2, bound="positive"),
        steps=int(steps),
        timeout=settings.number("settle_timeout", 3.0, bound="positive"),
    )


def read_robot(settings: Settings) -> RobotModel | None:
    """Return the robot of `model` and `joints`; None: the settings say what is wrong with it."""
    path, joints = settings.file("model"), settings.names("joints")
    if path is None or not joints:
        return None
    try:
        return RobotModel(path, joints, bounded=True)
    except WiringError as exc:
        for problem in str(exc).splitlines():
            settings.note("model", problem)
        return None


def _read_collisions(settings: Settings, robot: RobotModel | None) -> SelfCollisions | None:
    margin = settings.number("collision_margin", 0.01, bound="not negative")
    if not settings.has("srdf"):
        settings.value("srdf", "")
        return None
    path = settings.file("srdf")
    if path is None or robot is None:
        return None
    try:
        return SelfCollisions(robot, path, margin)
    except WiringError as exc:
        settings.note("srdf", str(exc))
        return None
