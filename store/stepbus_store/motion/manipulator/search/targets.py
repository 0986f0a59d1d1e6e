"""What a goal wants of the arm, in the robot's base."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Indices, RobotModel, Vector
from stepbus_participant import suggest
from stepbus_schemas import BaseState, Goal, RunError
from stepbus_store.motion.goals.outcome import FARTHEST, Refused

ODOMETRY = "odometry"
"""Frame of a goal: the base's pose at the start."""


def base_in_odometry(base: BaseState) -> Any:
    """Return the pose of the base in the frame of odometry, a `pinocchio.SE3`."""
    turn = pin.Quaternion(math.cos(base.yaw / 2), 0.0, 0.0, math.sin(base.yaw / 2))
    return pin.SE3(turn.matrix(), np.array([base.x, base.y, 0.0]))


def frame_in_base(robot: RobotModel, q: Vector, base: BaseState, frame: str) -> Any:
    """Return the pose of a goal's frame in the robot's base, a `pinocchio.SE3`.

    q: shape (n,) [rad]. frame: a link, `odometry`, or empty for the base. Raises Refused for an
    unknown one.
    """
    if frame == ODOMETRY:
        return base_in_odometry(base).inverse()
    try:
        return robot.frame_pose(q, frame)
    except RunError as exc:
        raise Refused("invalid", str(exc)) from exc


def target_pose(goal: Goal) -> Any:
    """Return the pose that a goal wants in its own frame, a `pinocchio.SE3`.

    Raises Refused for a goal without a valid pose.
    """
    if goal.position is None or goal.orientation is None:
        raise Refused("invalid", f"type {goal.type} needs position and orientation")
    length = math.hypot(*goal.orientation)
    if not math.isfinite(sum(goal.position)) or not abs(length - 1.0) <= 1e-3:
        text = f"position {goal.position} or orientation {goal.orientation} is no pose"
        raise Refused("invalid", f"{text}; the quaternion x, y, z, w has length {length:g}, not 1")
    if max(map(abs, goal.position)) > FARTHEST:
        text = f"position {goal.position} m is more than {FARTHEST:g} m away"
        raise Refused("unreachable", f"unreachable: {text}")
    turn = pin.Quaternion(np.array(goal.orientation) / length)
    return pin.SE3(turn.matrix(), np.array(goal.position))


def target_joints(goal: Goal, robot: RobotModel, q: Vector) -> tuple[Vector, Indices]:
    """Return the positions that `move_joints` wants, shape (n,) [rad], and which joints it names.

    The other joints stay at q. Raises Refused for unknown joints and values beyond their limits.
    """
    if len(goal.joints) != len(goal.values) or not goal.joints:
        counts = f"{len(goal.values)} values for {len(goal.joints)} joints"
        raise Refused("invalid", f"type move_joints has {counts}")
    target, named = q.copy(), [_index(robot.joints, name) for name in goal.joints]
    for name, index, value in zip(goal.joints, named, goal.values, strict=True):
        low, high = robot.lower[index], robot.upper[index]
        if not low <= value <= high:
            text = f"{name} cannot go to {value:g} {robot.unit(name)}"
            raise Refused("invalid", f"{text}, its limits are [{low:g}, {high:g}]")
        target[index] = value
    return target, np.array(named, dtype=np.intp)


def _index(joints: Sequence[str], name: str) -> int:
    if name not in joints:
        raise Refused("invalid", f"joint {name!r} is unknown{suggest(name, joints)}")
    return joints.index(name)
