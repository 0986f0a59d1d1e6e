"""Coming to rest faster than a motion would, as far as the motors can."""

from __future__ import annotations

import numpy as np

from stepbus_kinematics import RobotModel
from stepbus_motion.paths.motion import JointMotion, Motion, MotionLimits, stop_from
from stepbus_motion.paths.trajectories import is_strong_enough

_SHARES = (1.0, 0.5, 0.25)
"""Of the hardest braking, that are tried."""


def hard_stop(
    now: JointMotion, robot: RobotModel, usual: MotionLimits, acceleration: float, jerk: float
) -> Motion:
    """Return the shortest of some ways to stop that the motors are strong enough for.

    usual: limits that are never undercut. acceleration, jerk: of the hardest [rad/s², rad/s³].
    """
    for share in _SHARES:
        limits = MotionLimits(
            velocity=usual.velocity,
            acceleration=np.maximum(usual.acceleration, share * acceleration),
            jerk=np.maximum(usual.jerk, share * jerk),
        )
        motion = stop_from(now, limits)
        if is_strong_enough(motion, robot):
            return motion
    return stop_from(now, usual)
