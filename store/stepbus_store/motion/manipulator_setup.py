"""The robot of an arm, and the limits of its joints."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions
from stepbus_participant import PerName, Problems
from stepbus_store.motion.joint_motion import MotionLimits
from stepbus_store.motion.joint_params import JointParams

_VELOCITY_SHARE = 0.8
"""Of the URDF's velocity limits, by default."""


def make_robot(
    params: JointParams, problems: Problems, posture: Mapping[str, float] | None = None
) -> RobotModel:
    """Return the robot of the arm; raises SettingsError with what is wrong with its model.

    posture: positions of other joints [rad or m].
    """
    robot = problems.attempt(
        ("model",), lambda: RobotModel(params.model, params.joints, posture=posture, bounded=True)
    )
    if robot is None:
        raise problems.error()
    return robot


def make_collisions(
    robot: RobotModel, srdf: Path | None, margin: float, problems: Problems
) -> SelfCollisions | None:
    """Return the check of a robot against itself; None: there is no SRDF, or a problem with it."""
    if srdf is None:
        return None
    return problems.attempt(("srdf",), lambda: SelfCollisions(robot, srdf, margin))


def make_limits(
    params: JointParams, robot: RobotModel, acceleration: PerName, jerk: PerName
) -> MotionLimits:
    """Return the limits of the joints; acceleration, jerk: [rad/s², rad/s³]."""
    velocity = _VELOCITY_SHARE * robot.velocity_limit
    if params.velocity_limit is not None:
        velocity = np.array(params.velocity_limit.of(robot.joints))
    return MotionLimits(
        velocity=velocity,
        acceleration=np.array(acceleration.of(robot.joints)),
        jerk=np.array(jerk.of(robot.joints)),
    )
