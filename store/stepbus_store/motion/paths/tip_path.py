"""Paths of the tip: poses along a straight line."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Vector

EVERY_M = 0.01
"""Distance of the poses of a path for which the joints are solved [m]; cubics with exact slopes
stay within a micrometre of the path in between."""

_EVERY_RAD = 0.05
"""The same, where the tip turns [rad]."""


@dataclass(frozen=True, kw_only=True)
class TipPose:
    """One pose on a path of the tip.

    u: length of the path so far [m]; turning counts too, see `line`. pose: of the tip in the
    robot's base, a `pinocchio.SE3`. twist: its derivative by u, in the axes of the base, shape
    (6,) [-, rad/m].
    """

    u: float
    pose: Any
    twist: Vector


def line(start: Any, end: Any, radius: float) -> list[TipPose]:
    """Return the straight path between two `pinocchio.SE3`, turning evenly (slerp).

    radius: length that a turn of 1 rad counts, where turning takes longer than moving [m].
    """
    shift = end.translation - start.translation
    turn = start.rotation @ pin.log3(start.rotation.T @ end.rotation)
    angle = float(np.linalg.norm(turn))
    length = max(float(np.linalg.norm(shift)), angle * radius)
    if length < 1e-9:
        return []
    count = max(math.ceil(np.linalg.norm(shift) / EVERY_M), math.ceil(angle / _EVERY_RAD), 1)
    twist = np.concatenate([shift, turn]) / length
    poses = []
    for share in np.linspace(0.0, 1.0, count + 1):
        rotation = pin.exp3(turn * share) @ start.rotation
        pose = pin.SE3(rotation, start.translation + share * shift)
        poses.append(TipPose(u=float(share) * length, pose=pose, twist=twist))
    return poses
