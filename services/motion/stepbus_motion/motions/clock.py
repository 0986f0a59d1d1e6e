"""The clock of a motion: it slows down, stops and runs again without a jerk of the joints."""

import math

import numpy as np

from stepbus_kinematics import Vector

from .trajectory import Trajectory

_FASTEST_RAMP = 10.0
"""Largest change of the rate, for motions that are slow or at rest [1/s]."""

_LEAST_SHARE = 0.3
"""Of the acceleration limit, always available to change the rate, so that the rate can change."""


class MotionClock:
    """Time of a motion that runs `rate` times as fast as simulation time.

    The path of the joints stays the same (path-velocity decomposition: Kant, Zucker, Toward
    Efficient Trajectory Planning, 1986). A change of the rate accelerates the joints by q'·rate';
    the clock spreads it so that this stays within what q''·rate² leaves of the acceleration limit,
    shape (n,) [rad/s²].

    s: time of the motion, at simulation time t [s].
    """

    def __init__(self, acceleration: Vector) -> None:
        self._limit = acceleration
        self.s = 0.0
        self.t = 0.0
        self.rate = 1.0

    def restart(self, rate: float) -> None:
        """Start a motion at a rate."""
        self.s, self.rate = 0.0, rate

    def time_at(self, t: float) -> float:
        """Return the time of the motion at a simulation time, if the rate stays as it is [s]."""
        return self.s + self.rate * (t - self.t)

    def catch_up(self, t: float) -> None:
        """Bring the clock to a simulation time, at the rate that it has [s]."""
        self.s += self.rate * (t - self.t)
        self.t = t

    def advance(self, dt: float, wanted: float, trajectory: Trajectory) -> None:
        """Move on by dt [s], towards the wanted rate, 0 to 1."""
        rate = wanted
        if rate != self.rate:
            steepest = self._steepest(trajectory) * dt
            rate = self.rate + min(max(wanted - self.rate, -steepest), steepest)
        self.s += 0.5 * (self.rate + rate) * dt
        self.t += dt
        self.rate = rate

    def _steepest(self, trajectory: Trajectory) -> float:
        """Return the largest change of the rate [1/s]."""
        now = trajectory.at(self.s)
        room = self._limit - np.abs(now.acceleration) * self.rate**2
        room = np.maximum(room, _LEAST_SHARE * self._limit)
        moving = np.abs(now.velocity) > 1e-9
        if not moving.any():
            return _FASTEST_RAMP
        steepest = float((room[moving] / np.abs(now.velocity[moving])).min())
        return min(steepest, _FASTEST_RAMP) if math.isfinite(steepest) else _FASTEST_RAMP
