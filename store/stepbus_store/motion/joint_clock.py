"""The clock of a motion: it slows down, stops and runs again without a jerk of the joints."""

import math
from typing import Any

import numpy as np

from stepbus_kinematics import Vector
from stepbus_store.motion.trajectory import Trajectory

_FASTEST_RAMP = 10.0
"""Largest change of the rate, for motions that are slow or at rest [1/s]."""

_LEAST_SHARE = 0.15
"""Of the jerk limit, always available to change the rate, so that the rate can change."""

_SERVO_SHARE = 0.3
"""Of the jerk that is left, with which a change of the rate is planned to end."""

_STEPS_AHEAD = 3
"""How far the limits are looked up along the motion [steps]."""

_SMALL = 1e-9
"""Velocity of a joint that stands still [rad/s]."""

_JERK_SHARE = 0.7
"""Of the jerk limits, for motion and change of the rate together; the rest is for jumps between."""


class MotionClock:
    """Time of a motion that runs `rate` times as fast as simulation time.

    The path of the joints stays the same (path-velocity decomposition: Kant, Zucker, Toward
    Efficient Trajectory Planning, 1986). The joints accelerate by q''·rate² + q'·rate', and jerk by
    q'''·rate³ + 3·q''·rate·rate' + q'·rate''; the clock changes its rate so that both stay within
    their limits, each of shape (n,) [rad/s², rad/s³].

    s: time of the motion, at simulation time t [s].
    """

    def __init__(self, acceleration: Vector, jerk: Vector) -> None:
        self._acceleration = acceleration
        self._jerk = _JERK_SHARE * jerk
        self.s = 0.0
        self.t = 0.0
        self.rate = 1.0
        self._ramp = 0.0

    def restart(self, rate: float) -> None:
        """Start a motion at a rate."""
        self.s, self.rate, self._ramp = 0.0, rate, 0.0

    def time_at(self, t: float) -> float:
        """Return the time of the motion at a simulation time, if the rate stays as it is [s]."""
        return self.s + self.rate * (t - self.t)

    def catch_up(self, t: float) -> None:
        """Bring the clock to a simulation time, at the rate that it has [s]."""
        self.s, self.t = self.time_at(t), t

    def advance(self, dt: float, wanted: float, trajectory: Trajectory) -> None:
        """Move on by dt [s], towards the wanted rate, 0 to 1."""
        self._ramp = self._next_ramp(dt, wanted, trajectory)
        rate = min(max(self.rate + self._ramp * dt, 0.0), 1.0)
        self._ramp = (rate - self.rate) / dt
        self.s += 0.5 * (self.rate + rate) * dt
        self.t += dt
        self.rate = rate

    def _next_ramp(self, dt: float, wanted: float, trajectory: Trajectory) -> float:
        """Return the change of the rate during the next dt [1/s]."""
        error = wanted - self.rate
        if error == 0.0 and self._ramp == 0.0:
            return 0.0
        now = trajectory.at(self.s)
        moving = np.abs(now.velocity) > _SMALL
        if not moving.any():
            return min(max(error / dt, -_FASTEST_RAMP), _FASTEST_RAMP)
        velocity = now.velocity[moving]
        low, high = self._curvature(dt, trajectory, moving)
        least = _LEAST_SHARE * float((self._jerk[moving] / np.abs(velocity)).min())
        steepest = _SERVO_SHARE * max(min(-low, high), least)
        slowest, fastest = self._slope(dt, trajectory, moving)
        # The change that can still end where the error is 0.
        most = math.sqrt(2.0 * steepest * abs(error))
        towards = math.copysign(min(abs(error) / dt, most), error)
        ramp = min(max(towards, slowest), fastest)
        low, high = min(low, -least), max(high, least)
        ramp = min(max(ramp, self._ramp + low * dt), self._ramp + high * dt)
        return min(max(ramp, -_FASTEST_RAMP), _FASTEST_RAMP)

    def _curvature(self, dt: float, trajectory: Trajectory, moving: Any) -> tuple[float, float]:
        """Return the range of rate'' within the jerk limits, now and in the next steps [1/s²]."""
        rate, reach = self.rate, max(self.rate, 0.05) * dt
        states = [trajectory.at(self.s + k * reach) for k in range(_STEPS_AHEAD + 1)]
        pushes = np.array([state.acceleration[moving] for state in states])
        velocity, push = states[0].velocity[moving], pushes[0]
        ranges = [
            _interval(jerk * rate**3 + 3 * push * rate * self._ramp, velocity, self._jerk[moving])
            for jerk in np.diff(pushes, axis=0) / reach
        ]
        return max(low for low, _ in ranges), min(high for _, high in ranges)

    def _slope(self, dt: float, trajectory: Trajectory, moving: Any) -> tuple[float, float]:
        """Return the range of rate' within the acceleration limits, now and soon [1/s]; 0 is in it.

        The jerk limits give rate' some steps to follow.
        """
        ranges = []
        for ahead in (0, _STEPS_AHEAD):
            state = trajectory.at(self.s + ahead * self.rate * dt)
            velocity = state.velocity[moving]
            velocity = np.where(np.abs(velocity) > _SMALL, velocity, _SMALL)
            push = state.acceleration[moving] * self.rate**2
            ranges.append(_interval(push, velocity, self._acceleration[moving]))
        low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
        return min(low, 0.0), max(high, 0.0)


def _interval(have: Vector, per_unit: Vector, limit: Vector) -> tuple[float, float]:
    """Return the values x for which |have + per_unit · x| stays within a limit, for all joints."""
    ends = np.array([(-limit - have) / per_unit, (limit - have) / per_unit])
    return float(ends.min(axis=0).max()), float(ends.max(axis=0).min())
