"""Stop as fast as the motors can."""

from __future__ import annotations

import numpy as np

from stepbus_kinematics import RobotModel

from .fitting import is_strong_enough
from .joint_motion import JointMotion, Motion, MotionLimits, stop_from

_SHARES = (1.0, 0.5, 0.25)
"""Of the hardest braking, tried in this order."""


def hard_stop(
    now: JointMotion, robot: RobotModel, limits: MotionLimits, acceleration: float, jerk: float
) -> Motion:
    """Return the shortest of some stops that the motors are strong enough for.

    limits: braking is never softer. acceleration, jerk: of the hardest stop [rad/s², rad/s³].
    """
    for share in _SHARES:
        harder = MotionLimits(
            velocity=limits.velocity,
            acceleration=np.maximum(limits.acceleration, share * acceleration),
            jerk=np.maximum(limits.jerk, share * jerk),
        )
        motion = stop_from(now, harder)
        if is_strong_enough(motion, robot):
            return motion
    return stop_from(now, limits)
