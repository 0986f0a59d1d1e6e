"""Stop as fast as the motors can."""

import math
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import RobotModel
from stepbus_store.motion.fitting import is_strong_enough, sampled
from stepbus_store.motion.joint_motion import JointMotion, Motion, MotionLimits, stop_from
from stepbus_store.motion.trajectory import Retimed, Trajectory

_SHARES = (1.0, 0.5, 0.25)
"""Of the hardest braking, tried in this order."""

_SAMPLE_S = 0.008
"""Between two positions of the tip of which its acceleration is computed [s]."""

_ON_PATH = (1.0, 0.7, 0.5, 0.35, 0.25)
"""The same on a path, whose curves and own braking need a part of the limits."""


@dataclass(frozen=True)
class TipLimit:
    """Largest acceleration of a frame of the robot [m/s²]."""

    frame: str
    acceleration: float

    def is_kept(self, motion: Motion, robot: RobotModel) -> bool:
        """Return whether a motion keeps it."""
        count = max(math.ceil(motion.duration / _SAMPLE_S), 2)
        times = (n * motion.duration / count for n in range(count + 1))
        tips = [robot.frame_pose(motion.at(t).position, self.frame).translation for t in times]
        pushes = np.diff(tips, n=2, axis=0) / (motion.duration / count) ** 2
        return float(np.linalg.norm(pushes, axis=1).max()) <= self.acceleration


def hard_stop(
    now: JointMotion,
    robot: RobotModel,
    limits: MotionLimits,
    acceleration: float,
    jerk: float,
    *,
    tip: TipLimit | None = None,
) -> Motion:
    """Return the shortest of some stops that the motors are strong enough for.

    limits: braking is never softer. acceleration, jerk: of the hardest stop [rad/s², rad/s³]. tip:
    kept by all but the softest one.
    """
    for share in _SHARES:
        harder = limits.at_least(share * acceleration, share * jerk)
        motion = stop_from(now, harder)
        if is_strong_enough(motion, robot) and (tip is None or tip.is_kept(motion, robot)):
            return motion
    return stop_from(now, limits)


def stop_on_path(trajectory: Trajectory, s: float, rate: float, limits: MotionLimits) -> Trajectory:
    """Return a stop of a trajectory that stays on its path.

    s: its time now [s]. rate: at which that runs. limits: of the joints.
    """
    now = JointMotion(position=np.array([s]), velocity=np.array([rate]), acceleration=np.zeros(1))
    speed = np.maximum(np.abs(trajectory.at(s).velocity), 1e-9)
    hardest = float((limits.acceleration / speed).min()), float((limits.jerk / speed).min())
    for share in _ON_PATH:
        timing = stop_from(now, MotionLimits.of_one(1.0, share * hardest[0], share * hardest[1]))
        motion = Retimed(trajectory, timing)
        pushes = np.abs([state.acceleration for state in sampled(motion, least=20)])
        if bool((pushes <= limits.acceleration * (1.0 + 1e-6)).all()):
            break
    return motion
