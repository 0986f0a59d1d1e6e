"""Joint velocities from positions, where only these are sensed."""

import math
from typing import Protocol

import numpy as np

from stepbus_controller import Params
from stepbus_kinematics import Vector

Sample = tuple[list[float], int]
"""A vector, shape (n,), and when it was measured [ns]."""


class VelocityEstimator(Protocol):
    """Turns a series of positions into velocities."""

    def update(self, position: Vector, t_ns: int) -> Vector:
        """Return the velocities at the newest sample, shape (n,) [rad/s].

        position: shape (n,) [rad]. t_ns: when it was measured [ns], later than the one before.
        """
        ...

    def save(self) -> list[Sample]:
        """Return what it remembers, for a checkpoint."""
        ...

    def restore(self, saved: list[Sample]) -> None:
        """Take what `save` returned."""
        ...


class FiniteDifference:
    """v = (q_k − q_{k−1}) / (t_k − t_{k−1}), and 0 at the first sample."""

    def __init__(self) -> None:
        self._position: Vector | None = None
        self._t_ns = 0

    def update(self, position: Vector, t_ns: int) -> Vector:
        """See `VelocityEstimator`."""
        last, last_ns = self._position, self._t_ns
        self._position, self._t_ns = position, t_ns
        if last is None:
            return np.zeros_like(position)
        return (position - last) / ((t_ns - last_ns) * 1e-9)

    def save(self) -> list[Sample]:
        """See `VelocityEstimator`."""
        return [] if self._position is None else [(self._position.tolist(), self._t_ns)]

    def restore(self, saved: list[Sample]) -> None:
        """See `VelocityEstimator`."""
        for position, t_ns in saved:
            self._position, self._t_ns = np.array(position), t_ns


class FilteredDifference:
    """The finite difference behind a first-order low-pass filter.

    cutoff_hz: corner frequency [Hz]. With α = exp(−2π f Δt), v_k = α v_{k−1} + (1 − α) Δq / Δt:
    the exact discretisation of the filter for a constant input during Δt (Åström and Wittenmark,
    Computer-Controlled Systems, 3rd ed. 1997, chapter 2). It lags by 1 / (2π f).
    """

    def __init__(self, cutoff_hz: float) -> None:
        self._rate = 2.0 * math.pi * cutoff_hz
        self._difference = FiniteDifference()
        self._velocity: Vector | None = None
        self._t_ns = 0

    def update(self, position: Vector, t_ns: int) -> Vector:
        """See `VelocityEstimator`."""
        difference = self._difference.update(position, t_ns)
        if self._velocity is None:
            self._velocity = difference
        else:
            keep = math.exp(-self._rate * (t_ns - self._t_ns) * 1e-9)
            self._velocity = keep * self._velocity + (1.0 - keep) * difference
        self._t_ns = t_ns
        return self._velocity

    def save(self) -> list[Sample]:
        """See `VelocityEstimator`."""
        if self._velocity is None:
            return []
        return [*self._difference.save(), (self._velocity.tolist(), self._t_ns)]

    def restore(self, saved: list[Sample]) -> None:
        """See `VelocityEstimator`."""
        if saved:
            self._difference.restore(saved[:1])
            self._velocity, self._t_ns = np.array(saved[1][0]), saved[1][1]


def make_estimator(params: Params) -> VelocityEstimator | None:
    """Return what estimates velocities; None: the measured velocity is used."""
    if params.velocity == "filtered":
        return FilteredDifference(params.cutoff_hz)
    return FiniteDifference() if params.velocity == "finite_difference" else None
