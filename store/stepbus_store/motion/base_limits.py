"""How fast a base may drive, and how hard it brakes."""

import math

from stepbus_store.motion.base_segments import Segment, Turn
from stepbus_store.motion.joint_motion import MotionLimits
from stepbus_store.motion.mobile.params import Params

PLANNED = 0.8
"""Share of the accelerations that a reference uses; the rest brings the base back to it."""

_ON_CURVES = 0.95
"""Share of the largest turning speed that a curve may take: below it, the base still finds back."""

_EMERGENCY = 1.5
"""Of the hardest braking without slip, for what appears within its path."""

_BRAKE_RISE = 0.04
"""Time in which the hardest braking builds up [s]."""

_CREEP = 0.03
"""Slowest speed near things [m/s]."""

_REACTION = 0.04
"""Time from a measurement to its effect on the wheels [s]."""

_HALF_WIDTH = 0.3
"""Of the robot [m]."""


def limits_of(params: Params, segment: Segment) -> MotionLimits:
    """Return the limits along a segment, shape (1,); on a curve the base also turns."""
    if isinstance(segment, Turn):
        turning = PLANNED * params.base_turn_acceleration
        return MotionLimits.of_one(params.base_turn_speed, turning, params.base_turn_jerk)
    sharpest = max(segment.sharpest, 1e-9)
    return MotionLimits.of_one(
        min(params.base_speed, _ON_CURVES * params.base_turn_speed / sharpest),
        PLANNED * min(params.base_acceleration, params.base_turn_acceleration / sharpest),
        min(params.base_jerk, params.base_turn_jerk / sharpest),
    )


def braking(params: Params, *, turns: bool) -> MotionLimits:
    """Return the limits of the hardest stop without slip, shape (1,)."""
    speed = params.base_turn_speed if turns else params.base_speed
    brake = params.base_turn_brake if turns else params.base_brake
    return MotionLimits.of_one(speed, brake, brake / _BRAKE_RISE)


def hardest(params: Params, speed: float, gap: float, *, turns: bool) -> float:
    """Return how hard to brake for what is near [m/s², rad/s²].

    speed: [m/s, rad/s]. gap: to the nearest thing [m]. Only where the hardest stop without slip
    would not do, it is harder.
    """
    brake = float(braking(params, turns=turns).acceleration[0])
    room = max(gap - params.base_clearance, 1e-6) / (params.safe_reach if turns else 1.0)
    return brake * (_EMERGENCY if speed**2 > 2.0 * brake * room else 1.0)


def safe_speed(params: Params, gap: float, *, turns: bool, curvature: float = 0.0) -> float:
    """Return the largest speed with which the base stops in time [m/s, rad/s].

    gap: to the nearest thing [m]. The path of reaction and braking, v·t + v²/2a, ends at
    `clearance` (ISO 13855, 2010, section 5). In a turn the farthest point of the robot counts;
    on a curve, of a curvature [1/m], the fastest one.
    """
    brake = params.base_turn_brake * params.safe_reach if turns else params.base_brake
    room, before = max(gap - params.base_clearance, 0.0), brake * _REACTION
    speed = max(math.sqrt(before**2 + 2 * brake * room) - before, _CREEP)
    if turns:
        return speed / params.safe_reach
    turning = abs(curvature)
    return speed / math.hypot(1.0 + turning * _HALF_WIDTH, turning * params.safe_reach)
