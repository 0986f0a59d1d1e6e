"""How fast a base may drive along a curve, which bends more here than there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import Vector

_STRAIGHT = 1e-9
"""Least curvature, and least change of it, that counts [1/m, 1/m²]."""


@dataclass(frozen=True, kw_only=True)
class Agility:
    """Largest speed [m/s], turning speed [rad/s], acceleration [m/s²] and turning one [rad/s²].

    twist: largest jerk of a turn [rad/s³]. last: speed at the end of a curve [m/s].
    """

    speed: float
    turning: float
    push: float
    swing: float
    twist: float
    last: float = 0.0

    def pushes(self, curvature: Vector) -> Vector:
        """Return the largest acceleration along a curve where it bends like that [m/s²]."""
        return np.minimum(self.push, self.swing / np.maximum(np.abs(curvature), _STRAIGHT))

    def speeds(self, along: Vector, curvature: Vector) -> Vector:
        """Return the largest speeds at places [m/s] from which the base still slows down in time.

        along: of the places, and the curvature there, which changes evenly between them, shape (k,)
        each [m, 1/m].
        """
        steps = np.diff(along)
        rates = np.diff(curvature) / steps
        # With it, curvature, its change and the change of that turn the base: ω, ω' and ω''.
        jolts = np.pad(2.0 * np.abs(np.diff(rates)) / (steps[1:] + steps[:-1]), 1)
        rates = np.maximum(*(np.pad(np.abs(rates), pad) for pad in ((0, 1), (1, 0))))
        bends, rates, jolts = (np.maximum(np.abs(r), _STRAIGHT) for r in (curvature, rates, jolts))
        fastest = np.minimum(self.turning / bends, np.cbrt(self.twist / jolts))
        squares = np.minimum(np.minimum(fastest, self.speed) ** 2, self.swing / rates)
        squares[-1] = min(self.last**2, squares[-1])
        pushes = self.pushes(curvature)
        # What it gains on its way from place to place.
        gained = np.insert(np.cumsum(2.0 * np.minimum(pushes[1:], pushes[:-1]) * steps), 0, 0.0)
        slowed = np.minimum.accumulate((squares + gained)[::-1])[::-1] - gained
        return np.asarray(np.sqrt(np.maximum(slowed, 0.0)))

    def seconds(self, along: Vector, curvature: Vector) -> float:
        """Return how long the base takes from rest to rest [s]."""
        back = self.speeds(along[-1] - along[::-1], curvature[::-1])[::-1]
        speeds = np.minimum(self.speeds(along, curvature), back)
        return float((2.0 * np.diff(along) / (speeds[1:] + speeds[:-1])).sum())
