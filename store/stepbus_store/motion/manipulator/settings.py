"""Arms of two types, put together."""

from collections.abc import Mapping

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions
from stepbus_participant import PerName, Problems
from stepbus_store.motion.branches import BranchSolver
from stepbus_store.motion.ik_search import InverseKinematics
from stepbus_store.motion.joint_motion import MotionLimits
from stepbus_store.motion.joint_params import JointParams
from stepbus_store.motion.manipulator.candidates import BranchCandidates, SearchedCandidates
from stepbus_store.motion.manipulator.manipulator import Manipulator
from stepbus_store.motion.manipulator.options import ManipulatorOptions
from stepbus_store.motion.manipulator.routes import DetourRouter, DirectRouter
from stepbus_store.motion.manipulator.segments import SegmentFitter
from stepbus_store.motion.spiral import SpiralPlanner


def branching_manipulator(
    robot: RobotModel,
    limits: MotionLimits,
    settling: JointParams,
    options: ManipulatorOptions,
    *,
    seed: int,
    uses_planner: bool = False,
    collisions: SelfCollisions | None = None,
) -> Manipulator:
    """Return an arm that knows all its solutions, and avoids obstacles by a planner.

    seed: of the search for poses without an analytic solution. uses_planner: without it, the arm
    goes straight, and nothing checks for obstacles. collisions: with itself, of lines, spirals,
    motions without a planner, and stops; None: not checked.
    """
    solver = BranchSolver(
        robot,
        seed=seed,
        singular_below=options.singular_below,
        effort_share=options.effort_share,
    )
    spirals = SpiralPlanner(robot, solver, options)
    finder = BranchCandidates(robot, options, solver, spirals, collisions)
    segments = SegmentFitter(robot, limits, options.tip_limits, options.effort_share)
    router = None if uses_planner else DirectRouter(limits, segments, collisions)
    return Manipulator(finder, limits, settling, options, router=router, collisions=collisions)


def searching_manipulator(
    robot: RobotModel,
    limits: MotionLimits,
    settling: JointParams,
    *,
    period: float,
    seed: int,
    collisions: SelfCollisions | None = None,
    tries_unholdable: bool = False,
) -> Manipulator:
    """Return an arm of any number of joints that avoids colliding with itself.

    period: between two commands [s]. seed: of all that is random. collisions: None: not checked.
    tries_unholdable: it also goes to poses that the motors cannot hold.
    """
    # It stops within the limits of its motions.
    options = ManipulatorOptions(period=period, tip="", brake_acceleration=0.0, brake_jerk=0.0)
    ik = InverseKinematics(robot, seed=seed, collisions=collisions)
    finder = SearchedCandidates(robot, ik, tries_unholdable=tries_unholdable)
    router = DetourRouter(robot, limits, seed=seed, collisions=collisions)
    return Manipulator(finder, limits, settling, options, router=router)


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
