"""How a base follows its reference: its limits, and the feedback law."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from stepbus_schemas import BaseCommand, BaseState
from stepbus_store.motion.base_segments import Reference, Segment, Turn
from stepbus_store.motion.joint_motion import MotionLimits
from stepbus_store.motion.mobile.params import Params
from stepbus_store.pace import Agility

PLANNED, _PLANNED_JERK = 0.85, 0.8
"""Shares of accelerations and jerks that a reference uses; the rest brings the base back to it."""

GENTLE = 0.65
"""Share of a gap for which the base slows down; for all of it, it brakes."""

_ON_CURVES = 0.95
"""Share of the largest turning speed that a curve may take: below it, the base still finds back."""

_BRAKE_RISE = 0.04
"""Time in which the hardest braking builds up [s]."""

_CREEP = 0.03
"""Slowest speed near things [m/s]."""

_REACTION = 0.04
"""Time from a measurement to its effect on the wheels [s]."""

_HALF_WIDTH = 0.3
"""Of the robot [m]."""


_SLOWS = 0.8
"""Share of that acceleration with which it slows down before a bend: that and the bend turn it."""


def limits_of(
    params: Params, segment: Segment, s: float = 0.0, speed: float = 0.0, pushed: float = 0.0
) -> MotionLimits:
    """Return the limits along a segment after s of it, shape (1,); on a curve the base also turns.

    speed, pushed: speed and acceleration that the base has there [m/s, m/s²].
    """
    swing, twist = PLANNED * params.base_turn_acceleration, _PLANNED_JERK * params.base_turn_jerk
    if isinstance(segment, Turn):
        return MotionLimits.of_one(params.base_turn_speed, swing, twist)
    push, jerk = PLANNED * params.base_acceleration, _PLANNED_JERK * params.base_jerk
    agility = Agility(
        speed=params.base_speed,
        turning=_ON_CURVES * params.base_turn_speed,
        push=_SLOWS * push,
        swing=_SLOWS * swing,
        twist=_SLOWS * twist,
        last=math.inf,
    )
    # The way until it slows down like that: (a + a_s)² / (2 j a_s) long.
    turned = max(math.copysign(pushed, pushed * speed) + agility.push, 0.0)
    lead = abs(speed) * turned**2 / (2.0 * jerk * agility.push)
    fastest, slows = segment.limits(s, lead, agility)
    share = slows / agility.push
    return MotionLimits.of_one(max(fastest, _CREEP), share * push, share * jerk)


def braking(params: Params, *, turns: bool) -> MotionLimits:
    """Return the limits of the hardest stop without slip, shape (1,)."""
    speed = params.base_turn_speed if turns else params.base_speed
    brake = params.base_turn_brake if turns else params.base_brake
    return MotionLimits.of_one(speed, brake, brake / _BRAKE_RISE)


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

_ALONG, _ACROSS, _HEADING = 4.0, 25.0, 4.0
"""Gains of the law [1/s, 1/m², 1/s]."""

_ASIDE = 0.15
"""Largest angle at which the base goes back to its line [rad]."""

_SETTLED_IN, _SPARE_JERK = 0.03, 0.4
"""Time in which a small error of a velocity ends [s]; share of the jerk that a large one takes."""

_HOLDING_SPEED, _HOLDING_TURN = 0.02, 0.05
"""Largest velocities at which a base at rest goes back to its pose [m/s, rad/s]."""


class TrackingError(NamedTuple):
    """How far the reference is ahead [m], to the left [m], and turned [rad]."""

    along: float = 0.0
    across: float = 0.0
    angle: float = 0.0


def tracking_error(wanted: Reference, state: BaseState) -> TrackingError:
    """Return where the reference is in the frame of the base."""
    dx, dy = wanted.x - state.x, wanted.y - state.y
    cos, sin = math.cos(state.yaw), math.sin(state.yaw)
    return TrackingError(cos * dx + sin * dy, cos * dy - sin * dx, wanted.yaw - state.yaw)


def tracking_command(
    wanted: Reference, error: TrackingError, params: Params, *, holds: bool
) -> BaseCommand:
    """Return the velocities that bring a base to its reference.

    By Kanayama et al. (A Stable Tracking Control Method for an Autonomous Mobile Robot, 1990),
    v = v_r cos e_θ + K_x e_x, ω = ω_r + v_r K_y e_y + K_θ sin e_θ. There K_θ grows with v_r; here
    it does not, since a base that turns on the spot has to find its heading too. holds: at rest,
    it corrects slowly. A large error is corrected no faster than the base can brake again. error:
    of what has been measured, from where the reference was then.
    """
    spare, spare_turning = (
        (1.0 - PLANNED) * most for most in (params.base_acceleration, params.base_turn_acceleration)
    )
    along = _braked(_ALONG * error.along, error.along, spare)
    vx = wanted.vx * math.cos(error.angle) + along
    aside = wanted.vx * _ACROSS / _HEADING * error.across
    angle = math.sin(error.angle) + min(max(aside, -_ASIDE), _ASIDE)
    wz = wanted.wz + _braked(_HEADING * angle, angle, spare_turning)
    most = _HOLDING_SPEED if holds else _HEADROOM * params.base_speed
    most_turning = _HOLDING_TURN if holds else _HEADROOM * params.base_turn_speed
    return BaseCommand(vx=min(max(vx, -most), most), wz=min(max(wz, -most_turning), most_turning))


def _braked(correction: float, error: float, brake: float) -> float:
    """Return a correction no faster than it can end with the error, braking like that."""
    return math.copysign(min(abs(correction), math.sqrt(2.0 * brake * abs(error))), correction)


@dataclass
class LimitedSpeed:
    """The velocity of a command, driving or turning, within limits of acceleration and jerk.

    normal: both limits; braking: those of the brake. most: speed that neither takes it beyond.
    push: acceleration in the latest step.
    """

    normal: tuple[float, float]
    braking: tuple[float, float]
    most: float
    value: float = 0.0
    push: float = 0.0
    brakes: bool = False

    def stop(self) -> None:
        """Be 0 at once: the wheels are locked."""
        self.value, self.push, self.brakes = 0.0, 0.0, False

    def follow(self, wanted: float, own: float, dt: float, *, brakes: bool) -> float:
        """Return the velocity after a step of dt [s], on its way to a wanted one.

        own: acceleration of what it follows. The limits of the brake hold until that is reached.
        """
        if not brakes:
            brakes = self.brakes and abs(self.push - own) > self.normal[1] * dt
        self.brakes = brakes
        most, jerk = self.braking if brakes else self.normal
        push, missing = own, wanted - own * dt - self.value
        if not brakes:
            fastest = math.sqrt(2.0 * _SPARE_JERK * jerk * abs(missing))
            push += math.copysign(min(abs(missing) / _SETTLED_IN, fastest), missing)
        # It ends at the largest speed.
        up, down = (
            math.sqrt(2.0 * jerk * max(self.most + v, 0.0)) for v in (-self.value, self.value)
        )
        push = min(max(push, -down), up)
        push = min(max(push, self.push - jerk * dt), self.push + jerk * dt)
        self.push = min(max(push, -most), most)
        self.value += self.push * dt
        return self.value


def limited_speeds(params: Params) -> tuple[LimitedSpeed, LimitedSpeed]:
    """Return those of driving and of turning, at rest."""
    rows = (
        (params.base_speed, params.base_acceleration, params.base_jerk, params.base_brake),
        (
            params.base_turn_speed,
            params.base_turn_acceleration,
            params.base_turn_jerk,
            params.base_turn_brake,
        ),
    )
    one, other = (
        LimitedSpeed((push, jerk), (brake, brake / _BRAKE_RISE), _HEADROOM * speed)
        for speed, push, jerk, brake in rows
    )
    return one, other


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
