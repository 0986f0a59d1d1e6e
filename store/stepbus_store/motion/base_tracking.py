"""How a base follows its reference: its limits, and the feedback law."""

import math
from typing import NamedTuple

from stepbus_schemas import BaseCommand, BaseState
from stepbus_store.motion.base_segments import Reference, Segment, Turn
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


_HEADROOM = 1.015
"""How much faster than its reference the base may go to catch up with it."""

_ALONG, _ACROSS, _HEADING = 6.0, 40.0, 4.0
"""Gains of the law [1/s, 1/m², 1/s]."""

_HOLDING_SPEED, _HOLDING_TURN = 0.02, 0.05
"""Largest velocities at which a base at rest goes back to its pose [m/s, rad/s]."""


class TrackingError(NamedTuple):
    """How far the reference is ahead [m], to the left [m], and turned [rad]."""

    along: float
    across: float
    angle: float


def tracking_error(wanted: Reference, state: BaseState) -> TrackingError:
    """Return where the reference is in the frame of the base."""
    dx, dy = wanted.x - state.x, wanted.y - state.y
    cos, sin = math.cos(state.yaw), math.sin(state.yaw)
    return TrackingError(cos * dx + sin * dy, cos * dy - sin * dx, wanted.yaw - state.yaw)


def tracking_command(
    wanted: Reference, state: BaseState, params: Params, *, holds: bool
) -> BaseCommand:
    """Return the velocities that bring a base to its reference.

    By Kanayama et al. (A Stable Tracking Control Method for an Autonomous Mobile Robot, 1990),
    v = v_r cos e_θ + K_x e_x, ω = ω_r + v_r K_y e_y + K_θ sin e_θ. There K_θ grows with v_r; here
    it does not, since a base that turns on the spot has to find its heading too. holds: at rest,
    it corrects slowly. A large error is corrected no faster than the base can brake again.
    """
    error = tracking_error(wanted, state)
    spare, spare_turning = (
        (1.0 - PLANNED) * most for most in (params.base_acceleration, params.base_turn_acceleration)
    )
    along = _braked(_ALONG * error.along, error.along, spare)
    angle = math.sin(error.angle)
    vx = wanted.vx * math.cos(error.angle) + along
    across = wanted.vx * _ACROSS * error.across
    wz = wanted.wz + across + _braked(_HEADING * angle, angle, spare_turning)
    most = _HOLDING_SPEED if holds else _HEADROOM * params.base_speed
    most_turning = _HOLDING_TURN if holds else _HEADROOM * params.base_turn_speed
    return BaseCommand(vx=min(max(vx, -most), most), wz=min(max(wz, -most_turning), most_turning))


def _braked(correction: float, error: float, brake: float) -> float:
    """Return a correction no faster than it can end with the error, braking like that."""
    return math.copysign(min(abs(correction), math.sqrt(2.0 * brake * abs(error))), correction)


def within_limits(
    command: BaseCommand, before: BaseCommand, step: BaseCommand, params: Params, dt: float
) -> BaseCommand:
    """Return a command that leaves the one before no faster than the base may accelerate.

    So the base goes gently after what it has lost, and what a map corrects at once. step: by how
    much the reference itself changes: where that brakes harder, so does the base. dt: between the
    two [s].
    """

    def limited(now: float, last: float, own: float, acceleration: float) -> float:
        most = max(acceleration * dt, abs(own))
        return min(max(now, last - most), last + most)

    return BaseCommand(
        vx=limited(command.vx, before.vx, step.vx, params.base_acceleration),
        wz=limited(command.wz, before.wz, step.wz, params.base_turn_acceleration),
    )


def slow_wheels(state: BaseState, sent: BaseCommand, track: float, *, least: float = 0.02) -> str:
    """Return a sentence naming the wheels that roll at less than half of their command, if any.

    track: between the wheels [m]. least: slowest command that counts [m/s].
    """
    rows = [
        (side, state.vx + sign * track / 2 * state.wz, sent.vx + sign * track / 2 * sent.wz)
        for side, sign in (("left", -1), ("right", 1))
    ]
    slow = [
        # Adding 0 makes of -0 a 0.
        f"the {side} wheel rolls at {round(now, 2) + 0.0:.2f} m/s instead of {wanted:.2f} m/s"
        for side, now, wanted in rows
        if abs(wanted) > least and now / wanted < 0.5
    ]
    return f"{' and '.join(slow)}: is it jammed?" if slow else ""
