"""How a base moves."""

import math
from dataclasses import dataclass

from stepbus_store.motion.base_segments import Curve, Segment
from stepbus_store.motion.joint_motion import MotionLimits

PLANNED = 0.8
"""Share of the accelerations that a reference uses; the rest brings the base back to it."""

_ON_CURVES = 0.95
"""Share of the largest turning speed that a curve may take: below it, the base still finds back."""

_EMERGENCY = 1.5
"""Of the hardest braking without slip, for what appears within its path."""

_BRAKE_RISE = 0.04
"""Time in which the hardest braking builds up [s]."""


@dataclass(frozen=True, kw_only=True)
class BaseSettings:
    """How a base moves.

    speed, acceleration, jerk: along its path [m/s, m/s², m/s³]. turn_speed, turn_acceleration,
    turn_jerk: on the spot [rad/s, rad/s², rad/s³]. along, across, heading: gains of the law
    [1/s, 1/m², 1/s]. position, angle: largest error of a goal [m, rad]. still, still_turning:
    largest velocity that counts as standing [m/s, rad/s]. steps: of standing, in a row. timeout:
    for that, after the end of the motion [s]. lag, lag_angle: behind its reference by more, the
    base is jammed [m, rad]. track: between the wheels, to tell which of them lags [m]. brake,
    turn_brake: of the hardest stop without slip [m/s², rad/s²]. clearance: what stands still comes
    no closer than that [m]. creep: slowest speed near things [m/s]. reaction: from a measurement to
    its effect on the wheels [s]. reach: of the robot's farthest point from the axis of a turn,
    half_width: of the robot [m].
    """

    speed: float = 0.5
    acceleration: float = 0.4
    jerk: float = 2.0
    turn_speed: float = 0.8
    turn_acceleration: float = 0.8
    turn_jerk: float = 4.0
    along: float = 6.0
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
    brake: float = 4.0
    turn_brake: float = 10.0
    clearance: float = 8e-3
    creep: float = 0.03
    reaction: float = 0.04
    reach: float = 0.9
    half_width: float = 0.3

    def limits_of(self, segment: Segment | Curve) -> MotionLimits:
        """Return the limits along a segment, shape (1,); on a curve the base also turns."""
        if segment.turns:
            turning = PLANNED * self.turn_acceleration
            return MotionLimits.of_one(self.turn_speed, turning, self.turn_jerk)
        sharpest = max(segment.sharpest, 1e-9)
        return MotionLimits.of_one(
            min(self.speed, _ON_CURVES * self.turn_speed / sharpest),
            PLANNED * min(self.acceleration, self.turn_acceleration / sharpest),
            min(self.jerk, self.turn_jerk / sharpest),
        )

    def braking(self, *, turns: bool) -> MotionLimits:
        """Return the limits of the hardest stop without slip, shape (1,)."""
        speed = self.turn_speed if turns else self.speed
        brake = self.turn_brake if turns else self.brake
        return MotionLimits.of_one(speed, brake, brake / _BRAKE_RISE)

    def hardest(self, speed: float, gap: float, *, turns: bool) -> float:
        """Return how hard to brake for what is near [m/s², rad/s²].

        speed: [m/s, rad/s]. gap: to the nearest thing [m]. Only where the hardest stop without slip
        would not do, it is harder.
        """
        brake = float(self.braking(turns=turns).acceleration[0])
        room = max(gap - self.clearance, 1e-6) / (self.reach if turns else 1.0)
        return brake * (_EMERGENCY if speed**2 > 2.0 * brake * room else 1.0)

    def safe_speed(self, gap: float, *, turns: bool, curvature: float = 0.0) -> float:
        """Return the largest speed with which the base stops in time [m/s, rad/s].

        gap: to the nearest thing [m]. The path of reaction and braking, v·t + v²/2a, ends at
        `clearance` (ISO 13855, 2010, section 5). In a turn the farthest point of the robot counts;
        on a curve, of a curvature [1/m], the fastest one.
        """
        brake = self.turn_brake * self.reach if turns else self.brake
        room, before = max(gap - self.clearance, 0.0), brake * self.reaction
        speed = max(math.sqrt(before**2 + 2 * brake * room) - before, self.creep)
        if turns:
            return speed / self.reach
        turning = abs(curvature)
        return speed / math.hypot(1.0 + turning * self.half_width, turning * self.reach)
