"""Drives and turns a mobile base by odometry feedback: smooth profiles, and a law that follows."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from stepbus_motion.goals.outcome import Outcome, Refused
from stepbus_motion.goals.targets import FARTHEST
from stepbus_motion.paths.motion import JointMotion, Motion, MotionLimits, motion_to, stop_from
from stepbus_schemas import BaseCommand, BaseState, Goal, RunError

from .segments import (
    Leg,
    PlannedLeg,
    Reference,
    same_line,
    straight,
    straight_to,
    turn_by,
    turn_to,
    turning,
    wrapped,
)

_BACK_TURN = 0.3
"""A turn goes back by the angle whose arc at this radius is the distance to go back [m]."""

_HEADROOM = 1.2
"""How much faster than its reference the base may go to catch up with it."""


@dataclass(frozen=True, kw_only=True)
class BaseSettings:
    """How a base moves.

    speed, acceleration, jerk: along its way [m/s, m/s², m/s³]. turn_speed, turn_acceleration,
    turn_jerk: on the spot [rad/s, rad/s², rad/s³]. along, across, heading: gains of the law
    [1/s, 1/m², 1/s]. position, angle: where it counts as there [m, rad]. still, still_turning:
    where it counts as standing [m/s, rad/s]. steps: so many in a row. timeout: for that, after
    the end of the motion [s]. lag, lag_angle: that much behind its reference it is jammed
    [m, rad]. track: between the wheels [m], to tell which of them lags.
    """

    speed: float = 0.5
    acceleration: float = 0.4
    jerk: float = 2.0
    turn_speed: float = 0.8
    turn_acceleration: float = 0.8
    turn_jerk: float = 4.0
    along: float = 3.0
    across: float = 40.0
    heading: float = 4.0
    position: float = 1e-3
    angle: float = math.radians(0.1)
    still: float = 5e-3
    still_turning: float = 1e-2
    steps: int = 5
    timeout: float = 3.0
    lag: float = 0.05
    lag_angle: float = math.radians(6.0)
    track: float = 0.5


@dataclass(kw_only=True)
class _Drive:
    """A leg under way: its profile, the profile's own time [s], since when it is over."""

    leg: Leg
    profile: Motion
    tau: float = 0.0
    late: float = 0.0
    settled: int = 0

    @property
    def is_over(self) -> bool:
        return self.tau >= self.profile.duration

    def now(self) -> tuple[float, float, float]:
        """Return way, speed and acceleration along the leg, in the profile's own time."""
        at = self.profile.at(self.tau)
        return float(at.position[0]), float(at.velocity[0]), float(at.acceleration[0])


_HOLDING_SPEED, _HOLDING_TURN = 0.02, 0.05
"""With which a base at rest goes back to where it shall stand, at most [m/s, rad/s]."""


class BaseMotion:
    """Carries out the goals `drive`, `turn` and `go_to`, one at a time, by odometry.

    The reference runs along the way by a profile of ruckig, and the base follows it by the law of
    Kanayama et al. (A Stable Tracking Control Method for an Autonomous Mobile Robot, 1990),
    v = v_r cos e_θ + K_x e_x, ω = ω_r + v_r K_y e_y + K_θ sin e_θ. There K_θ grows with v_r; here
    it does not, since a base that turns on the spot has to find its heading too.

    At rest it keeps its place by the same law, slowly: the swings of an arm would move it.
    In each step: `advance`, then `look`, then `command`.
    """

    def __init__(self, settings: BaseSettings) -> None:
        self._settings = settings
        self._state: BaseState | None = None
        self._drive: _Drive | None = None
        self._waiting: deque[PlannedLeg] = deque()
        self._scale = 1.0
        self._done = False
        self._sent = BaseCommand()
        self._target: tuple[float, float, float] | None = None
        self._place: Reference | None = None

    @property
    def is_moving(self) -> bool:
        """Return whether the base follows a reference."""
        return self._drive is not None

    def hold(self, state: BaseState) -> None:
        """Stand where the base is when it all begins."""
        self._state = state
        self._place = Reference(x=state.x, y=state.y, yaw=state.yaw, vx=0.0, wz=0.0)

    def begin(self, goal: Goal, state: BaseState) -> str:
        """Take in a goal; returns a sentence that says what will be done.

        Raises Refused for one that makes no sense; then nothing has changed.
        """
        self._state = state
        plans, text = self._plans(goal, state)
        if self._drive is not None and not self._drive.is_over:
            # The old way ends first, and the new one begins where the base then stands.
            self._brake(self._drive)
        else:
            self._drive = None
        self._waiting = plans
        self._done = False
        self._next_leg()
        return text

    def _plans(self, goal: Goal, state: BaseState) -> tuple[deque[PlannedLeg], str]:
        if goal.type == "drive":
            _refuse_odd("by", goal.by)
            self._target = None
            return deque([straight(goal.by)]), f"drive {goal.by:.3f} m"
        if goal.type == "turn":
            _refuse_odd("by", goal.by)
            self._target = None
            text = f"turn by {math.degrees(goal.by):.1f}°"
            return deque([turn_by(goal.by)]), text
        if goal.type != "go_to" or goal.base is None:
            raise Refused("invalid", f"type {goal.type} needs base: x, y, yaw")
        for name, value in zip(("x", "y", "yaw"), goal.base, strict=True):
            _refuse_odd(name, value)
        self._target = goal.base
        return self._plans_to(goal.base, state)

    def _plans_to(
        self, target: tuple[float, float, float], state: BaseState
    ) -> tuple[deque[PlannedLeg], str]:
        x, y, yaw = target
        way = math.hypot(x - state.x, y - state.y)
        text = f"go {way:.3f} m to x {x:.3f} m, y {y:.3f} m, yaw {math.degrees(yaw):.1f}°"
        last = turn_to(yaw)
        if way <= 2 * self._settings.position:
            return deque([last]), text
        ahead = math.atan2(y - state.y, x - state.x)
        back = turning(state, yaw, ahead + math.pi) < turning(state, yaw, ahead) - 1e-9
        first = turn_to(ahead + math.pi if back else ahead)
        return deque([first, straight_to(x, y, back=back), last]), text

    def stop(self) -> None:
        """Come to rest as fast as the limits allow."""
        self._waiting.clear()
        self._done = False
        self._target = None
        drive = self._drive
        if drive is not None and not drive.is_over:
            self._brake(drive)
        elif drive is not None:
            self._drive, self._place = None, self._reference(drive)

    def back_off(self, distance: float) -> float:
        """Stop, then go back the way the base came, no further than this leg's beginning.

        distance: [m]; a turn goes back by the angle that belongs to it. Returns the way [m].
        """
        drive = self._drive
        self.stop()
        if drive is None:
            return 0.0
        leg, (s, _, _) = drive.leg, drive.now()
        wanted = distance / _BACK_TURN if leg.turns else distance
        way = min(wanted, abs(s))
        self._waiting.append(same_line(leg, -math.copysign(way, s)))
        self._next_leg()
        return way * _BACK_TURN if leg.turns else way

    def advance(self, dt: float, scale: float) -> None:
        """Move the reference on by dt [s], at `scale` (0 to 1) of its speed.

        The scale is approached so that the base keeps its acceleration limit.
        """
        drive, settings = self._drive, self._settings
        most = settings.acceleration / settings.speed * dt
        self._scale += min(max(scale - self._scale, -most), most)
        if drive is None:
            return
        if drive.is_over:
            drive.late += dt
        drive.tau += dt * self._scale

    def command(self) -> BaseCommand:
        """Return how the base shall move now."""
        settings = self._settings
        if self._drive is not None:
            most, most_turning = _HEADROOM * settings.speed, _HEADROOM * settings.turn_speed
            self._sent = self._law(self._reference(self._drive), most, most_turning)
        elif self._place is not None:
            self._sent = self._law(self._place, _HOLDING_SPEED, _HOLDING_TURN)
        else:
            self._sent = BaseCommand()
        return self._sent

    def _law(self, wanted: Reference, most: float, most_turning: float) -> BaseCommand:
        settings = self._settings
        along, across, angle = self._error(wanted)
        vx = wanted.vx * math.cos(angle) + settings.along * along
        wz = wanted.wz + wanted.vx * settings.across * across + settings.heading * math.sin(angle)
        return BaseCommand(
            vx=min(max(vx, -most), most), wz=min(max(wz, -most_turning), most_turning)
        )

    def _reference(self, drive: _Drive) -> Reference:
        s, speed, _ = drive.now()
        return drive.leg.at(s, speed * self._scale)

    def _error(self, wanted: Reference) -> tuple[float, float, float]:
        """Return how far the reference is ahead [m], to the left [m], and turned [rad]."""
        state = self._now()
        dx, dy = wanted.x - state.x, wanted.y - state.y
        cos, sin = math.cos(state.yaw), math.sin(state.yaw)
        return cos * dx + sin * dy, cos * dy - sin * dx, wanted.yaw - state.yaw

    def look(self, state: BaseState) -> Outcome | None:
        """Take in odometry; returns how the goal has ended, if so."""
        self._state = state
        drive = self._drive
        if drive is None:
            if self._place is not None and self._is_lost(*self._error(self._place)):
                # Somebody has pushed it away: to push back would make it worse.
                self._place = None
            # All legs may have been too short to be driven.
            return self._finish() if self._done else None
        along, across, angle = self._error(self._reference(drive))
        if self._is_lost(along, across, angle):
            return self._jammed(drive, math.hypot(along, across), angle)
        return self._settle(drive, along, angle) if drive.is_over else None

    def _is_lost(self, along: float, across: float, angle: float) -> bool:
        settings = self._settings
        return max(abs(along), abs(across)) > settings.lag or abs(angle) > settings.lag_angle

    def _settle(self, drive: _Drive, along: float, angle: float) -> Outcome | None:
        settings, state = self._settings, self._now()
        is_there = abs(along) <= settings.position and abs(angle) <= settings.angle
        stands = abs(state.vx) <= settings.still and abs(state.wz) <= settings.still_turning
        drive.settled = drive.settled + 1 if is_there and stands else 0
        if drive.settled >= settings.steps:
            self._drive, self._place = None, self._reference(drive)
            self._next_leg()
            return self._finish() if self._done else None
        if drive.late <= settings.timeout:
            return None
        off = f"{along * 1e3:.1f} mm and {math.degrees(angle):.2f}° off"
        text = f"not settled {drive.late:.2f} s after the motion: {off}"
        return self._give_up("not_settled", text)

    def _finish(self) -> Outcome:
        self._done = False
        state = self._now()
        text = f"stands at x {state.x:.4f} m, y {state.y:.4f} m, "
        text += f"yaw {math.degrees(state.yaw):.2f}°"
        if self._target is not None:
            x, y, yaw = self._target
            miss = math.hypot(x - state.x, y - state.y)
            yaw = state.yaw + wrapped(yaw - state.yaw)
            self._place = Reference(x=x, y=y, yaw=yaw, vx=0.0, wz=0.0)
            text += f"; {miss * 1e3:.1f} mm off"
        return Outcome(state="succeeded", text=text)

    def _jammed(self, drive: _Drive, miss: float, angle: float) -> Outcome:
        leg = drive.leg
        text = (
            f"the base is {miss * 1e3:.0f} mm and {abs(math.degrees(angle)):.1f}° behind after "
            f"{leg.shown(drive.now()[0])} of {leg.shown(leg.length)}; {self._slow_wheels()}"
        )
        return self._give_up("jammed", text)

    def _slow_wheels(self) -> str:
        """Return which wheels go less than half as fast as they shall, by odometry."""
        state, sent, half = self._now(), self._sent, self._settings.track / 2
        rows = [
            (side, state.vx + sign * half * state.wz, sent.vx + sign * half * sent.wz)
            for side, sign in (("left", -1), ("right", 1))
        ]
        slow = [
            # Adding 0 makes of -0 a 0.
            f"the {side} wheel rolls at {round(now, 2) + 0.0:.2f} m/s instead of {wanted:.2f} m/s"
            for side, now, wanted in rows
            if abs(wanted) > 0.02 and now / wanted < 0.5
        ]
        return f"{' and '.join(slow)}: is it jammed?" if slow else "is a wheel jammed?"

    def _give_up(self, cause: str, text: str) -> Outcome:
        self._drive, self._place = None, None
        self._waiting.clear()
        self._done = False
        return Outcome(state="failed", cause=cause, text=text)

    def _next_leg(self) -> None:
        """Begin the next leg, once nothing is under way; none left: all is done."""
        while self._drive is None and self._waiting:
            leg = self._waiting.popleft()(self._now())
            if leg is not None:
                self._drive = _Drive(leg=leg, profile=self._profile(leg))
        self._done = self._drive is None

    def _profile(self, leg: Leg) -> Motion:
        start = JointMotion.at_rest(np.zeros(1))
        return motion_to(start, np.array([leg.length]), self._limits(leg))

    def _limits(self, leg: Leg) -> MotionLimits:
        settings = self._settings
        straight = (settings.speed, settings.acceleration, settings.jerk)
        turning = (settings.turn_speed, settings.turn_acceleration, settings.turn_jerk)
        velocity, acceleration, jerk = turning if leg.turns else straight
        return MotionLimits(
            velocity=np.array([velocity]),
            acceleration=np.array([acceleration]),
            jerk=np.array([jerk]),
        )

    def _brake(self, drive: _Drive) -> None:
        """Let the reference of a leg come to rest, from the speed that it has now."""
        s, speed, acceleration = drive.now()
        now = JointMotion(
            position=np.array([s]),
            velocity=np.array([speed * self._scale]),
            acceleration=np.array([acceleration * self._scale**2]),
        )
        profile = stop_from(now, self._limits(drive.leg))
        self._drive = _Drive(leg=drive.leg, profile=profile)
        self._scale = 1.0

    def _now(self) -> BaseState:
        if self._state is None:
            raise RunError("the base has not been measured yet")
        return self._state


def _refuse_odd(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise Refused("invalid", f"{name} is {value}, not a finite number")
    if abs(value) > FARTHEST:
        raise Refused("invalid", f"{name} is {value:g}; more than {FARTHEST:g} m or rad is too far")
