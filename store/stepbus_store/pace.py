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

    last: speed at the end of a curve [m/s].
    """

    speed: float
    turning: float
    push: float
    swing: float
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
        rates = np.abs(np.diff(curvature)) / steps
        rates = np.maximum(np.append(rates, 0.0), np.insert(rates, 0, 0.0))
        bends = np.maximum(np.abs(curvature), _STRAIGHT)
        fastest = np.minimum(self.speed, self.turning / bends)
        squares = np.minimum(fastest**2, self.swing / np.maximum(rates, _STRAIGHT))
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
