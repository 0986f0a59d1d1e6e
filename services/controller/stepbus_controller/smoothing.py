"""Filters of measurements: smoothers, each with the delay that it costs, and velocities."""

import math
from typing import Protocol

import numpy as np

from stepbus_controller.params import Params
from stepbus_kinematics import Vector


class Smoother(Protocol):
    """A filter of measurements; memory: its state. delay: of a slow signal [s]."""

    memory: list[Vector]
    delay: float

    def update(self, values: Vector) -> Vector:
        """Return the smoothed values; values: the newest measurement. Both of shape (n,)."""
        ...


class LowPass:
    """y_k = α y_{k−1} + (1 − α) x_k with α = exp(−Δt / τ), a first-order low-pass filter.

    time_constant: τ [s]. period: Δt [s]. Its delay at low frequency is Δt α / (1 − α), the slope
    of its phase at 0 (Oppenheim and Schafer, Discrete-Time Signal Processing, section 5.1).
    """

    def __init__(self, time_constant: float, period: float) -> None:
        self.memory: list[Vector] = []
        self._keep = math.exp(-period / time_constant)
        self.delay = period * self._keep / (1.0 - self._keep)

    def update(self, values: Vector) -> Vector:
        """See `Smoother`."""
        last = self.memory[0] if self.memory else values
        self.memory = [self._keep * last + (1.0 - self._keep) * values]
        return self.memory[0]


class MovingAverage:
    """The mean of the newest samples, which lags by half the window at every frequency.

    window: number of samples. period: between two samples [s]. Until the window is full, its oldest
    sample stands for those before it.
    """

    def __init__(self, window: int, period: float) -> None:
        self.memory: list[Vector] = []
        self._window = window
        self.delay = (window - 1) / 2 * period

    def update(self, values: Vector) -> Vector:
        """See `Smoother`."""
        before = self.memory or [values] * self._window
        self.memory = [*before[1:], values]
        mean: Vector = np.mean(self.memory, axis=0)
        return mean


class Differentiator:
    """Velocities from positions: v = (q_k − q_{k−1}) / (t_k − t_{k−1}), and 0 at the first sample.

    cutoff_hz: corner frequency of a first-order low-pass filter behind it [Hz]; None: there is
    none. With α = exp(−2π f Δt), v_k = α v_{k−1} + (1 − α) Δq / Δt: the exact discretisation of the
    filter for a constant input during Δt (Åström and Wittenmark, Computer-Controlled Systems,
    3rd ed. 1997, chapter 2). It lags by 1 / (2π f).
    """

    def __init__(self, cutoff_hz: float | None) -> None:
        self.memory: list[Vector] = []
        self._rate = None if cutoff_hz is None else 2.0 * math.pi * cutoff_hz

    def update(self, position: Vector, since_ns: int) -> Vector:
        """Return the velocities at the newest sample, shape (n,) [rad/s].

        position: shape (n,) [rad]. since_ns: from the sample before to this one [ns], above 0.
        """
        velocity = np.zeros_like(position)
        if self.memory:
            before, was = self.memory
            velocity = (position - before) / (since_ns * 1e-9)
            if self._rate is not None:
                keep = math.exp(-self._rate * since_ns * 1e-9)
                velocity = keep * was + (1.0 - keep) * velocity
        self.memory = [position, velocity]
        return velocity


def make_smoother(params: Params, period: float) -> Smoother | None:
    """Return the filter of the parameters; None: no smoothing.

    period: between two measurements [s].
    """
    if params.time_constant is not None:
        return LowPass(params.time_constant, period)
    return None if params.window is None else MovingAverage(params.window, period)
