"""Filters of measurements: smoother ones, each with the delay that it costs, and velocities."""

import math
from typing import Protocol

import numpy as np

from .model import Vector


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


class SavitzkyGolay:
    """Value, in the middle of a window, of the polynomial that fits its samples best.

    window: samples, odd. period: between two of them [s]. degree: of the polynomial; 0: the moving
    average. Its delay is half the window at every frequency (Savitzky and Golay, Analytical
    Chemistry 36, 1964). Until the window is full, its oldest sample stands for those before it.
    """

    def __init__(self, window: int, period: float, degree: int = 2) -> None:
        self.memory: list[Vector] = []
        half = window // 2
        powers = np.vander(np.arange(-half, half + 1), degree + 1, increasing=True)
        self._weights: Vector = np.linalg.pinv(powers)[0]
        self.delay = half * period

    def update(self, values: Vector) -> Vector:
        """See `Smoother`."""
        before = self.memory or [values] * len(self._weights)
        self.memory = [*before[1:], values]
        return self._weights @ np.array(self.memory)


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


def delay_warning(smoother: Smoother | None) -> list[str]:
    """Return the warning that reports the delay; none without smoothing."""
    if smoother is None:
        return []
    return [f"smoothing delays the measurements by {smoother.delay * 1e3:.1f} ms"]


def make_smoother(
    smoothing: str, time_constant: float | None, window: int | None, period: float
) -> Smoother | None:
    """Return a filter as `SmoothingParams` describe it; None: no smoothing.

    period: between two measurements [s].
    """
    if time_constant is not None:
        return LowPass(time_constant, period)
    degree = 2 if smoothing == "savitzky_golay" else 0
    return None if window is None else SavitzkyGolay(window, period, degree)
