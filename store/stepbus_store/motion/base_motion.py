"""Drives and turns a mobile base by odometry: smooth profiles, and a law that follows them."""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from stepbus_schemas import BaseCommand, BaseState, Goal, Point, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.base_segments import (
    PlannedSegment,
    Reference,
    Segment,
    straight,
    turn_by,
)
from stepbus_store.motion.base_tracking import (
    GENTLE,
    TrackingError,
    braking,
    limited_speeds,
    limits_of,
    safe_speed,
    slow_wheels,
    tracking_command,
    tracking_error,
)
from stepbus_store.motion.joint_motion import (
    JointMotion,
    Motion,
    MotionLimits,
    motion_to,
    stop_from,
)
from stepbus_store.motion.mobile.params import Params
from stepbus_store.motion.outcome import Outcome
from stepbus_store.motion.route import base_route
from stepbus_store.poses import wrapped

_BACK_TURN = 0.3
"""A turn backs off by the angle whose arc at this radius is the distance to back off [m]."""

_STILL, _STILL_TURNING = 5e-3, 1e-2
"""Largest velocities that count as standing [m/s, rad/s]."""

_ROUNDING = 1.001
"""Speeds and accelerations exceed their limits from this share on."""

_STEPS = 5
"""Of standing, in a row, until a base counts as settled."""

_WHICH = "is a wheel jammed?"

_APART = 0.1
"""Distance of the poses that `ahead` returns [m]."""


def _as_arc(segment: Segment, length: float) -> float:
    """Return a length along a segment, a turn as an arc [m]."""
    return length * (_BACK_TURN if segment.turns else 1.0)


@dataclass(kw_only=True)
class _Drive:
    """A segment under way: its profile, the time since that began, and since its end [s].

    pace: largest speed and acceleration of the profile. stops: it ends before the segment does.
    brakes: it has the limits of the brake.
    """

    segment: Segment
    profile: Motion
    pace: tuple[float, float] = (math.inf, math.inf)
    stops: bool = False
    brakes: bool = False
    tau: float = 0.0
    late: float = 0.0
    settled: int = 0

    @property
    def is_over(self) -> bool:
        return self.tau >= self.profile.duration

    def now(self) -> tuple[float, float, float]:
        """Return position, speed and acceleration along the segment."""
        at = self.profile.at(self.tau)
        return float(at.position[0]), float(at.velocity[0]), float(at.acceleration[0])


class BaseMotion:
    """Carries out the goals `drive`, `turn` and `go_to`, one at a time, by odometry.

    The reference runs along each segment by a profile of ruckig, and the base follows it; see
    `tracking_command`. At rest it keeps its pose by the same law, slowly: the swings of an arm
    would move it. In each step: `advance`, then `check`, then `command`.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._state: BaseState | None = None
        self._drive: _Drive | None = None
        self._waiting: deque[PlannedSegment] = deque()
        self._done = False
        self._sent = BaseCommand()
        self._wanted: Reference | None = None
        self._speeds, self._error = limited_speeds(params), TrackingError()
        self._dt = 0.0
        self._target: tuple[float, float, float] | None = None
        self._pose: Reference | None = None
        # The wheels are locked: for how many steps in a row the base has stood.
        self._halt: int | None = None
        self._behind: _Drive | None = None

    @property
    def is_moving(self) -> bool:
        """Return whether the base follows a reference that moves, or has yet to come to rest."""
        return self._drive is not None or self._halt is not None

    @property
    def state(self) -> BaseState:
        """Return odometry; raises RunError before the first one."""
        if self._state is None:
            raise RunError("the base has not been measured yet")
        return self._state

    @property
    def position(self) -> float:
        """Return the largest error at a goal [m]."""
        return self._params.base_position

    @property
    def is_halting(self) -> bool:
        """Return whether its wheels are locked, and it has not come to rest yet."""
        return self._halt is not None

    def hold(self, state: BaseState) -> None:
        """Stand where the base is."""
        self._state = state
        self._pose = Reference.standing(state.x, state.y, state.yaw)

    def interrupt(self, state: BaseState) -> None:
        """Give up any motion; something else brings the base to rest."""
        self._waiting.clear()
        self._done = False
        self._drive, self._target, self._halt = None, None, None
        self._lock()
        self.hold(state)

    def check_goal(self, goal: Goal, state: BaseState) -> str:
        """Return a sentence for the status of a goal; raises Refused for one without sense."""
        self._state = state
        return base_route(goal, state, self._params.base_position).text

    def start(self, goal: Goal, state: BaseState, route: Sequence[Point] = ()) -> str:
        """Start a goal and return a sentence for its status; route: of a planner.

        Raises Refused for a goal that makes no sense; then nothing has changed.
        """
        self._state = state
        planned = base_route(goal, state, self._params.base_position, route)
        self._behind = None
        self._target = planned.target
        if self._drive is not None and not self._drive.is_over:
            # The old segment ends first, and the new one starts where the base then stands.
            self._brake(self._drive)
        else:
            self._drive = None
        self._waiting = planned.segments
        self._done = False
        self._next_segment()
        return planned.text

    def stop(self) -> None:
        """Come to rest as fast as motors and ground allow without slip."""
        self._waiting.clear()
        self._done = False
        self._target = None
        drive = self._drive
        if drive is not None and not drive.is_over:
            self._brake(drive, hard=True)
        elif drive is not None:
            self._drive, self._pose = None, self._reference(drive)

    def halt(self) -> None:
        """Lock the wheels until the base stands, wherever that is."""
        if self._drive is not None:
            self._behind = self._drive
        self._waiting.clear()
        self._done = False
        self._drive, self._pose, self._target = None, None, None
        self._halt = 0

    def back_off(self, distance: float) -> bool:
        """Halt, then go back along the segment, no further than its start; False: it has not begun.

        distance: [m]; a turn goes back by the angle that belongs to it.
        """
        self.halt()
        drive = self._behind
        if drive is None or not drive.now()[0]:
            return False
        segment, (s, _, _) = drive.segment, drive.now()
        wanted = distance / _BACK_TURN if segment.turns else distance
        back = -math.copysign(min(wanted, abs(s)), s)
        self._waiting.append(turn_by(back) if segment.turns else straight(back))
        return True

    def travelled(self, start: BaseState) -> float:
        """Return how far odometry has moved since a state, a turn as an arc [m]."""
        now = self.state
        return math.hypot(now.x - start.x, now.y - start.y) + _BACK_TURN * abs(now.yaw - start.yaw)

    @property
    def remaining(self) -> float:
        """Return the length of the route that is left, a turn as an arc [m]."""
        left = sum(_as_arc(segment, abs(segment.length)) for segment in self._planned_ahead())
        if self._drive is not None:
            rest = abs(self._drive.segment.length) - abs(self._drive.now()[0])
            left += _as_arc(self._drive.segment, max(rest, 0.0))
        return left

    def ahead(self, route: Iterable[PlannedSegment] | None = None) -> list[tuple[float, Point]]:
        """Return poses along the route that is left, and how far each is from its end [m].

        route: instead of that. No point of the robot moves much more than 0.1 m between two; a turn
        counts as an arc.
        """
        poses: list[Point] = [(self.state.x, self.state.y, self.state.yaw)]
        lengths = [0.0]
        drive = self._drive
        parts: list[tuple[Segment, float]] = []
        if drive is not None and not drive.stops:
            parts.append((drive.segment, drive.now()[0]))
        parts += [(segment, 0.0) for segment in self._planned_ahead(route)]
        for segment, start in parts:
            left = _as_arc(segment, segment.length - start)
            # In a turn, what an arm holds out goes the farthest.
            farthest = (segment.length - start) * self._params.safe_reach if segment.turns else left
            count = max(math.ceil(abs(farthest) / _APART), 1)
            for n in range(1, count + 1):
                at = segment.at(start + (segment.length - start) * n / count, 0.0)
                poses.append((at.x, at.y, at.yaw))
                lengths.append(lengths[-1] + abs(left) / count)
        return [(lengths[-1] - s, pose) for s, pose in zip(lengths, poses, strict=True)]

    def _planned_ahead(self, route: Iterable[PlannedSegment] | None = None) -> list[Segment]:
        """Return the segments that have not begun, as they will be if the base is exact."""
        now = self.state
        segments: list[Segment] = []
        if self._drive is not None:
            end = self._drive.segment.at(self._drive.segment.length, 0.0)
            now = replace(now, x=end.x, y=end.y, yaw=end.yaw)
        for make in self._waiting if route is None else route:
            segment = make(now)
            if segment is not None:
                segments.append(segment)
                end = segment.at(segment.length, 0.0)
                now = replace(now, x=end.x, y=end.y, yaw=end.yaw)
        return segments

    def advance(self, dt: float, gap: float = math.inf) -> None:
        """Move the reference on by dt [s], so fast that the base could stop within a gap [m].

        It slows down within the limits of its segment, and brakes where that would not do.
        """
        self._dt, drive = dt, self._drive
        if drive is None:
            return
        self._adapt(drive, gap)
        drive = self._drive or drive
        drive.tau += dt
        if drive.is_over:
            drive.late += dt

    def _adapt(self, drive: _Drive, gap: float) -> None:
        """Plan what is left of a segment again where the base may be faster, or must be slower."""
        if drive.is_over and not drive.brakes:
            return
        segment, params = drive.segment, self._params
        hard = braking(params, turns=segment.turns)
        s, speed, push = self._commanded(drive) if drive.brakes else drive.now()
        limits = limits_of(params, segment, s, speed, push)
        curvature, share = segment.curvature(s), GENTLE if gap < params.contact_range else 1.0
        safe, gentle = (
            safe_speed(params, room, turns=segment.turns, curvature=curvature)
            for room in (gap, share * gap)
        )
        if drive.brakes:
            # Once it brakes, it does so until it can go on gently.
            safe = gentle
        must_brake = abs(speed) > _ROUNDING * safe
        if drive.stops:
            if must_brake and not drive.brakes:
                self._brake(drive, hard=True)
            return
        velocity, most, jerk = (
            float(row[0]) for row in (limits.velocity, limits.acceleration, limits.jerk)
        )
        fastest = min(gentle, velocity)
        if (fastest, most) == drive.pace and not must_brake and not drive.brakes:
            return
        if must_brake:
            drive.profile = stop_from(JointMotion.of_one(*self._commanded(drive)), hard)
        else:
            if drive.brakes:
                # From then on it slows down at most so hard that it does not go back.
                slowing = min(most, math.sqrt(2.0 * jerk * abs(speed)))
                push = min(max(push, -slowing), slowing)
            limits = MotionLimits.of_one(fastest, most, jerk)
            now = JointMotion.of_one(s, speed, push)
            drive.profile = motion_to(now, np.array([segment.length]), limits)
        drive.tau, drive.pace = 0.0, (fastest, most)
        if must_brake or drive.brakes:
            self._wanted = self._reference(drive)
        drive.brakes = must_brake

    def _commanded(self, drive: _Drive) -> tuple[float, float, float]:
        """Return where the base is on a segment, and velocity and acceleration of its command."""
        speed = self._speeds[drive.segment.turns]
        error = self._error.angle if drive.segment.turns else self._error.along
        return drive.now()[0] - error, speed.value, speed.push

    def command(self) -> BaseCommand:
        """Return the command of this step."""
        drive, before, dt = self._drive, self._wanted, self._dt
        now = self._wanted = self._reference(drive) if drive is not None else self._pose
        if now is None or self._halt is not None or dt == 0.0:
            self._lock()
            return self._sent
        before = before or now
        # What has been measured is how far the base has followed the step before.
        error = self._error = tracking_error(before, self.state)
        wanted = tracking_command(now, error, self._params, holds=drive is None)
        brakes = drive is not None and drive.brakes and not drive.is_over
        vx, wz = self._speeds
        self._sent = BaseCommand(
            vx=vx.follow(wanted.vx, (now.vx - before.vx) / dt, dt, brakes=brakes),
            wz=wz.follow(wanted.wz, (now.wz - before.wz) / dt, dt, brakes=brakes),
        )
        return self._sent

    def _lock(self) -> None:
        """Lock the wheels."""
        self._sent, self._wanted, self._error = BaseCommand(), None, TrackingError()
        for speed in self._speeds:
            speed.stop()

    def check(self, state: BaseState) -> Outcome | None:
        """Compare with odometry; return how the goal ended, once it has."""
        self._state = state
        if self._halt is not None:
            self._wait_for_rest(self._halt)
            return self._finish() if self._done else None
        drive = self._drive
        if drive is None:
            if self._pose is not None and self._is_lost(tracking_error(self._pose, state)):
                # Another body has pushed it away: to push back would make it worse.
                self._pose = None
            # All segments may have been too short to be driven.
            return self._finish() if self._done else None
        error = tracking_error(self._reference(drive), state)
        if self._is_lost(error):
            return self._jammed(drive, error)
        return self._settle(drive, error) if drive.is_over else None

    def _wait_for_rest(self, stood: int) -> None:
        """Go on once the base stands; what is to come starts there."""
        state = self.state
        self._halt = stood + 1 if self._stands(state) else 0
        if self._halt >= _STEPS:
            self._halt = None
            self._pose = Reference.standing(state.x, state.y, state.yaw)
            if self._waiting:
                self._next_segment()

    def _stands(self, state: BaseState) -> bool:
        return abs(state.vx) <= _STILL and abs(state.wz) <= _STILL_TURNING

    def _is_lost(self, error: TrackingError) -> bool:
        lag = max(abs(error.along), abs(error.across))
        return lag > self._params.base_lag or abs(error.angle) > self._params.base_lag_angle

    def _reference(self, drive: _Drive) -> Reference:
        s, speed, _ = drive.now()
        return drive.segment.at(s, speed)

    def _settle(self, drive: _Drive, error: TrackingError) -> Outcome | None:
        params, state = self._params, self.state
        is_there = (
            abs(error.along) <= params.base_position and abs(error.angle) <= params.base_angle
        )
        drive.settled = drive.settled + 1 if is_there and self._stands(state) else 0
        if drive.settled >= _STEPS:
            self._drive, self._pose = None, self._reference(drive)
            self._next_segment()
            return self._finish() if self._done else None
        if drive.late <= params.base_timeout:
            return None
        off = f"{error.along * 1e3:.1f} mm and {math.degrees(error.angle):.2f}° off"
        text = f"not settled {drive.late:.2f} s after the motion: {off}"
        slow = slow_wheels(state, self._sent, params.track, least=5e-3)
        if slow or self._stands(state):
            return self._give_up(Cause.JAMMED, f"{text}; {slow or _WHICH}")
        return self._give_up(Cause.NOT_SETTLED, text)

    def _finish(self) -> Outcome:
        self._done = False
        state = self.state
        text = f"stands at x {state.x:.4f} m, y {state.y:.4f} m, "
        text += f"yaw {math.degrees(state.yaw):.2f}°"
        if self._behind is not None:
            # It has backed off: what is told of its distance to things stays true.
            self._pose = Reference.standing(state.x, state.y, state.yaw)
        if self._target is not None:
            x, y, yaw = self._target
            miss = math.hypot(x - state.x, y - state.y)
            self._pose = Reference.standing(x, y, state.yaw + wrapped(yaw - state.yaw))
            text += f"; {miss * 1e3:.1f} mm off"
        return Outcome(state="succeeded", text=text)

    def _jammed(self, drive: _Drive, error: TrackingError) -> Outcome:
        segment, miss = drive.segment, math.hypot(error.along, error.across)
        text = (
            f"the base is {miss * 1e3:.0f} mm and {abs(math.degrees(error.angle)):.1f}° behind "
            f"after {segment.shown(drive.now()[0])} of {segment.shown(segment.length)}; "
            f"{slow_wheels(self.state, self._sent, self._params.track) or _WHICH}"
        )
        return self._give_up(Cause.JAMMED, text)

    def _give_up(self, cause: Cause, text: str) -> Outcome:
        self._drive, self._pose = None, None
        self._waiting.clear()
        self._done = False
        return Outcome(state="failed", cause=cause, text=text)

    def _next_segment(self) -> None:
        """Start the next segment, once nothing is under way; none left: all is done."""
        while self._drive is None and self._halt is None and self._waiting:
            segment = self._waiting.popleft()(self.state)
            # A small turn the base makes while it stands.
            if segment is not None and not (
                segment.turns and abs(segment.length) < self._params.base_angle / 2
            ):
                start, goal = JointMotion.at_rest(np.zeros(1)), np.array([segment.length])
                limits = limits_of(self._params, segment)
                self._drive = _Drive(segment=segment, profile=motion_to(start, goal, limits))
        self._done = self._drive is None and self._halt is None

    def _brake(self, drive: _Drive, *, hard: bool = False) -> None:
        """Bring the reference of a segment to rest, from the speed that it has now."""
        if drive.stops and not hard:
            return
        # What brakes already goes on with that.
        brakes = hard or drive.brakes
        limits = limits_of(self._params, drive.segment, *drive.now())
        if brakes:
            limits = braking(self._params, turns=drive.segment.turns)
        profile = stop_from(drive.profile.at(drive.tau), limits)
        self._drive = _Drive(segment=drive.segment, profile=profile, stops=True, brakes=brakes)
