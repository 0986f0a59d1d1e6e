"""Drives and turns a mobile base by odometry: smooth profiles, and a law that follows them."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from stepbus_motion.motions.joint_motion import JointMotion, Motion, motion_to, stop_from
from stepbus_motion.outcome import Outcome
from stepbus_schemas import BaseCommand, BaseState, Goal, RunError

from .route import base_route
from .segments import PlannedSegment, Reference, Segment, same_line, wrapped
from .settings import BaseSettings
from .tracking import TrackingError, slow_wheels, tracking_command, tracking_error

_BACK_TURN = 0.3
"""A turn backs off by the angle whose arc at this radius is the distance to back off [m]."""


@dataclass(kw_only=True)
class _Drive:
    """A segment under way: its profile, the profile's own time, the time since its end [s]."""

    segment: Segment
    profile: Motion
    tau: float = 0.0
    late: float = 0.0
    settled: int = 0

    @property
    def is_over(self) -> bool:
        return self.tau >= self.profile.duration

    def now(self) -> tuple[float, float, float]:
        """Return position, speed and acceleration along the segment, in the profile's own time."""
        at = self.profile.at(self.tau)
        return float(at.position[0]), float(at.velocity[0]), float(at.acceleration[0])


class BaseMotion:
    """Carries out the goals `drive`, `turn` and `go_to`, one at a time, by odometry.

    The reference runs along each segment by a profile of ruckig, and the base follows it; see
    `tracking_command`. At rest it keeps its pose by the same law, slowly: the swings of an arm
    would move it. In each step: `advance`, then `check`, then `command`.
    """

    def __init__(self, settings: BaseSettings) -> None:
        self._settings = settings
        self._state: BaseState | None = None
        self._drive: _Drive | None = None
        self._waiting: deque[PlannedSegment] = deque()
        self._scale = 1.0
        self._done = False
        self._sent = BaseCommand()
        self._target: tuple[float, float, float] | None = None
        self._pose: Reference | None = None

    @property
    def is_moving(self) -> bool:
        """Return whether the base follows a reference that moves."""
        return self._drive is not None

    def hold(self, state: BaseState) -> None:
        """Stand where the base is."""
        self._state = state
        self._pose = Reference.standing(state.x, state.y, state.yaw)

    def begin(self, goal: Goal, state: BaseState) -> str:
        """Start a goal and return a sentence for its status.

        Raises Refused for a goal that makes no sense; then nothing has changed.
        """
        self._state = state
        route = base_route(goal, state, self._settings.position)
        self._target = route.target
        if self._drive is not None and not self._drive.is_over:
            # The old segment ends first, and the new one starts where the base then stands.
            self._brake(self._drive)
        else:
            self._drive = None
        self._waiting = route.segments
        self._done = False
        self._next_segment()
        return route.text

    def stop(self) -> None:
        """Come to rest as fast as the limits allow."""
        self._waiting.clear()
        self._done = False
        self._target = None
        drive = self._drive
        if drive is not None and not drive.is_over:
            self._brake(drive)
        elif drive is not None:
            self._drive, self._pose = None, self._reference(drive)

    def back_off(self, distance: float) -> float:
        """Stop, then go back along the segment, no further than its start; return the length [m].

        distance: [m]; a turn goes back by the angle that belongs to it.
        """
        drive = self._drive
        self.stop()
        if drive is None:
            return 0.0
        segment, (s, _, _) = drive.segment, drive.now()
        wanted = distance / _BACK_TURN if segment.turns else distance
        length = min(wanted, abs(s))
        self._waiting.append(same_line(segment, -math.copysign(length, s)))
        self._next_segment()
        return length * _BACK_TURN if segment.turns else length

    def advance(self, dt: float, scale: float) -> None:
        """Move the reference on by dt [s], at `scale` (0 to 1) of its speed.

        The scale is approached so that the base keeps the acceleration limit of its segment: that
        of a turn is another one than that of a straight line.
        """
        drive = self._drive
        limits = self._settings.limits(turns=drive is not None and drive.segment.turns)
        most = float(limits.acceleration[0] / limits.velocity[0]) * dt
        self._scale += min(max(scale - self._scale, -most), most)
        if drive is None:
            return
        if drive.is_over:
            drive.late += dt
        drive.tau += dt * self._scale

    def command(self) -> BaseCommand:
        """Return the command of this step."""
        wanted = self._reference(self._drive) if self._drive is not None else self._pose
        if wanted is None:
            self._sent = BaseCommand()
        else:
            holds = self._drive is None
            self._sent = tracking_command(wanted, self._now(), self._settings, holds=holds)
        return self._sent

    def check(self, state: BaseState) -> Outcome | None:
        """Compare with odometry; return how the goal ended, once it has."""
        self._state = state
        drive = self._drive
        if drive is None:
            if self._pose is not None and self._is_lost(tracking_error(self._pose, state)):
                # Somebody has pushed it away: to push back would make it worse.
                self._pose = None
            # All segments may have been too short to be driven.
            return self._finish() if self._done else None
        error = tracking_error(self._reference(drive), state)
        if self._is_lost(error):
            return self._jammed(drive, error)
        return self._settle(drive, error) if drive.is_over else None

    def _is_lost(self, error: TrackingError) -> bool:
        return error.exceeds(self._settings.lag, self._settings.lag_angle)

    def _reference(self, drive: _Drive) -> Reference:
        s, speed, _ = drive.now()
        return drive.segment.at(s, speed * self._scale)

    def _settle(self, drive: _Drive, error: TrackingError) -> Outcome | None:
        settings, state = self._settings, self._now()
        is_there = abs(error.along) <= settings.position and abs(error.angle) <= settings.angle
        stands = abs(state.vx) <= settings.still and abs(state.wz) <= settings.still_turning
        drive.settled = drive.settled + 1 if is_there and stands else 0
        if drive.settled >= settings.steps:
            self._drive, self._pose = None, self._reference(drive)
            self._next_segment()
            return self._finish() if self._done else None
        if drive.late <= settings.timeout:
            return None
        off = f"{error.along * 1e3:.1f} mm and {math.degrees(error.angle):.2f}° off"
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
            self._pose = Reference.standing(x, y, state.yaw + wrapped(yaw - state.yaw))
            text += f"; {miss * 1e3:.1f} mm off"
        return Outcome(state="succeeded", text=text)

    def _jammed(self, drive: _Drive, error: TrackingError) -> Outcome:
        segment, miss = drive.segment, math.hypot(error.along, error.across)
        text = (
            f"the base is {miss * 1e3:.0f} mm and {abs(math.degrees(error.angle)):.1f}° behind "
            f"after {segment.shown(drive.now()[0])} of {segment.shown(segment.length)}; "
            f"{slow_wheels(self._now(), self._sent, self._settings.track)}"
        )
        return self._give_up("jammed", text)

    def _give_up(self, cause: str, text: str) -> Outcome:
        self._drive, self._pose = None, None
        self._waiting.clear()
        self._done = False
        return Outcome(state="failed", cause=cause, text=text)

    def _next_segment(self) -> None:
        """Start the next segment, once nothing is under way; none left: all is done."""
        while self._drive is None and self._waiting:
            segment = self._waiting.popleft()(self._now())
            if segment is not None:
                start, goal = JointMotion.at_rest(np.zeros(1)), np.array([segment.length])
                limits = self._settings.limits(turns=segment.turns)
                self._drive = _Drive(segment=segment, profile=motion_to(start, goal, limits))
        self._done = self._drive is None

    def _brake(self, drive: _Drive) -> None:
        """Let the reference of a segment come to rest, from the speed that it has now."""
        now = drive.profile.at(drive.tau).scaled(self._scale)
        profile = stop_from(now, self._settings.limits(turns=drive.segment.turns))
        self._drive = _Drive(segment=drive.segment, profile=profile)
        self._scale = 1.0

    def _now(self) -> BaseState:
        if self._state is None:
            raise RunError("the base has not been measured yet")
        return self._state
