"""The feedback law that makes a base follow its reference."""

import math
from typing import NamedTuple

from stepbus_schemas import BaseCommand, BaseState
from stepbus_store.motion.base_limits import PLANNED
from stepbus_store.motion.base_segments import Reference
from stepbus_store.motion.mobile.params import Params

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


def slow_wheels(state: BaseState, sent: BaseCommand, track: float) -> str:
    """Return a sentence naming the wheels that roll at less than half of their command.

    track: between the wheels [m].
    """
    rows = [
        (side, state.vx + sign * track / 2 * state.wz, sent.vx + sign * track / 2 * sent.wz)
        for side, sign in (("left", -1), ("right", 1))
    ]
    slow = [
        # Adding 0 makes of -0 a 0.
        f"the {side} wheel rolls at {round(now, 2) + 0.0:.2f} m/s instead of {wanted:.2f} m/s"
        for side, now, wanted in rows
        if abs(wanted) > 0.02 and now / wanted < 0.5
    ]
    return f"{' and '.join(slow)}: is it jammed?" if slow else "is a wheel jammed?"
