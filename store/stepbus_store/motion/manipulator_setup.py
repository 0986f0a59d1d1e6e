"""An arm, put together."""

from collections.abc import Mapping

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions
from stepbus_participant import PerName, Problems
from stepbus_store.motion.branches import BranchSolver
from stepbus_store.motion.candidates import CandidateFinder
from stepbus_store.motion.joint_motion import ManipulatorOptions, MotionLimits
from stepbus_store.motion.joint_params import JointParams
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.routes import DetourRouter


def make_manipulator(
    robot: RobotModel,
    limits: MotionLimits,
    settling: JointParams,
    options: ManipulatorOptions,
    *,
    seed: int,
    uses_planner: bool = False,
    collisions: SelfCollisions | None = None,
    tries_unholdable: bool = False,
) -> Manipulator:
    """Return an arm that avoids obstacles by a planner, or without one only itself.

    seed: of all that is random. collisions: of the robot with itself; None: not checked.
    tries_unholdable: it also goes to poses that the motors cannot hold.
    """
    share = options.effort_share
    solver = BranchSolver(robot, seed=seed, effort_share=share, collisions=collisions)
    finder = CandidateFinder(robot, solver, options, collisions, tries_unholdable=tries_unholdable)
    router = None
    if not uses_planner:
        router = DetourRouter(robot, limits, seed=seed, collisions=collisions, effort_share=share)
    return Manipulator(finder, limits, settling, options, router=router, collisions=collisions)


_VELOCITY_SHARE = 0.8
"""Of the URDF's velocity limits, by default."""


def make_robot(
    params: JointParams, problems: Problems, posture: Mapping[str, float] | None = None
) -> RobotModel:
    """Return the robot of the arm; raises SettingsError with what is wrong with its model.

    posture: positions of other joints [rad or m].
    """
    robot = problems.attempt(
        ("model",),
        lambda: RobotModel(params.model, params.joints, posture=posture, bounded=True),
    )
    if robot is None:
        raise problems.error()
    return robot


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
