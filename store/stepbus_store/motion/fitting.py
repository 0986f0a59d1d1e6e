"""Motions slowed down until motors can follow them."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from stepbus_kinematics import RobotModel
from stepbus_store.cause import Cause
from stepbus_store.motion.joint_motion import JointMotion, MotionLimits
from stepbus_store.motion.outcome import Refused
from stepbus_store.motion.trajectory import Stretched, Trajectory

_CHECKED_EVERY_S = 0.04
"""Distance of the states of a motion that are checked [s]."""

_ROUNDING = 1e-6

_JERK_OVER_S = 0.016
"""Time over which jerks are averaged [s]."""

_JERK_ROUNDING = 1.1
"""Share of the jerk limit up to which a motion counts as within it: plans are cubic in pieces."""


def sampled(trajectory: Trajectory, least: int = 100, most: int = 2000) -> list[JointMotion]:
    """Return states every 0.04 s, start and end included; least, most: bounds on the intervals."""
    count = min(max(math.ceil(trajectory.duration / _CHECKED_EVERY_S), least), most)
    return [trajectory.at(trajectory.duration * i / count) for i in range(count + 1)]


def fitted(
    trajectory: Trajectory,
    robot: RobotModel,
    limits: MotionLimits,
    *,
    effort_share: float = 1.0,
    least_duration: float = 0.0,
) -> Trajectory:
    """Return a motion slowed down until it keeps the limits of joints and torque.

    In f times the duration, velocities are 1/f, accelerations and dynamic torques 1/f², jerks 1/f³
    (Hollerbach, Dynamic Scaling of Manipulator Trajectories, 1984). least_duration: of the result
    [s]. Raises Refused where holding still takes more than `effort_share` of the effort limits.
    """
    states = sampled(trajectory)
    fast = max(float((np.abs(state.velocity) / limits.velocity).max()) for state in states)
    hard = max(float((np.abs(state.acceleration) / limits.acceleration).max()) for state in states)
    heavy = _torque_factor(states, robot, effort_share)
    jerky = _jerk_ratio(trajectory, limits)
    factor = max(fast, math.sqrt(hard), heavy, math.cbrt(jerky) if jerky > _JERK_ROUNDING else 1.0)
    # States between the checked ones may be a little worse; a motion that ruckig has timed is at
    # its limits up to rounding.
    factor = factor * 1.01 if factor > 1.0 + _ROUNDING else 1.0
    if trajectory.duration > 0:
        factor = max(factor, least_duration / trajectory.duration)
    return Stretched(trajectory, factor) if factor > 1.0 else trajectory


def all_fitted(
    parts: Sequence[Trajectory],
    robot: RobotModel,
    limits: MotionLimits,
    *,
    effort_share: float,
    least_duration: float,
) -> list[Trajectory]:
    """Return motions that follow one another, each `fitted`; least_duration: of all of them [s]."""
    fit = partial(fitted, robot=robot, limits=limits, effort_share=effort_share)
    within = [fit(part) for part in parts]
    total = sum(part.duration for part in within)
    if not 0 < total < least_duration:
        return within
    slower = least_duration / total
    return [fit(part, least_duration=part.duration * slower) for part in within]


def _jerk_ratio(trajectory: Trajectory, limits: MotionLimits) -> float:
    """Return the largest jerk, as a share of its limit; jumps of the acceleration are averaged."""
    count = min(math.ceil(trajectory.duration / _JERK_OVER_S), 2000)
    if count < 1:
        return 0.0
    times = np.arange(count + 2) * _JERK_OVER_S - 0.5 * _JERK_OVER_S
    pushes = [trajectory.at(t).acceleration if t > 0 else np.zeros_like(limits.jerk) for t in times]
    return float((np.abs(np.diff(pushes, axis=0)).max(axis=0) / _JERK_OVER_S / limits.jerk).max())


def is_strong_enough(trajectory: Trajectory, robot: RobotModel) -> bool:
    """Return whether the motors have the torque for a motion."""
    try:
        return _torque_factor(sampled(trajectory), robot, 1.0) <= 1.0
    except Refused:
        return False


def _torque_factor(states: Sequence[JointMotion], robot: RobotModel, share: float) -> float:
    """Return how many times the duration the motors need."""
    limit = robot.effort_limit * share
    # An arm that hangs in its motors' limits must be able to leave.
    limit = np.maximum(limit, 1.02 * np.abs(robot.gravity_torque(states[0].position)))
    factor = 1.0
    for state in states:
        static = robot.gravity_torque(state.position)
        if (np.abs(static) > limit).any():
            worst = int(np.argmax(np.abs(static) - limit))
            joint, unit = robot.joints[worst], robot.effort_unit(robot.joints[worst])
            text = f"{joint} needs {abs(static[worst]):.1f} {unit} on the path"
            text = f"not holdable: {text} and has {limit[worst]:.1f} {unit}"
            raise Refused(Cause.NOT_HOLDABLE, text)
        total = robot.inverse_dynamics(state.position, state.velocity, state.acceleration)
        moving = total - static
        room = np.maximum(limit - np.sign(moving) * static, 1e-9)
        factor = max(factor, math.sqrt(float((np.abs(moving) / room).max())))
    return factor
