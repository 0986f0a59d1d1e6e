"""Options of the motions of a manipulator."""

import math
from dataclasses import dataclass

from stepbus_store.motion.joint_motion import MotionLimits


@dataclass(frozen=True, kw_only=True)
class ManipulatorOptions:
    """How an arm moves.

    period: between two commands [s]. tip: frame whose path counts when the arm backs off, and whose
    error is reported; empty: errors of joints only. tip_velocity, tip_acceleration, tip_jerk: of
    lines and spirals [m/s, m/s², m/s³]. tip_turning: fastest turn of the tip [rad/s].
    plan_timeout: for the planner's answer [s of simulation]. effort_share: of the effort limits
    that motions may need. brake_acceleration, brake_jerk: of the hardest stop; the limits of the
    motion where they are larger [rad/s², rad/s³]. jam_lag: a joint that is further behind its
    command is jammed [rad, m].
    """

    period: float
    tip: str
    tip_velocity: float = 0.25
    tip_acceleration: float = 0.5
    tip_jerk: float = 5.0
    tip_turning: float = 1.0
    plan_timeout: float = 5.0
    effort_share: float = 0.9
    brake_acceleration: float = 15.0
    brake_jerk: float = 1000.0
    jam_lag: float = math.inf

    @property
    def turn_radius(self) -> float:
        """Return the length that a turn of 1 rad counts on a path of the tip [m]."""
        return self.tip_velocity / self.tip_turning

    @property
    def tip_limits(self) -> MotionLimits:
        """Return the limits along a path of the tip, shape (1,) [m/s, m/s², m/s³]."""
        return MotionLimits.of_one(self.tip_velocity, self.tip_acceleration, self.tip_jerk)
