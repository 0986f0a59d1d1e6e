"""Filters for noisy measurements, each with the delay that it costs."""

import math
from collections import deque
from typing import Protocol

import numpy as np

from .model import Vector


class Smoother(Protocol):
    """A filter that turns a series of measurements into a smoother one.

    delay: of a slow signal [s].
    """

    delay: float

    def update(self, values: Vector) -> Vector:
        """Return the smoothed values; values: the newest measurement. Both of shape (n,)."""
        ...

    def save(self) -> list[list[float]]:
        """Return what it remembers, for a checkpoint."""
        ...

    def restore(self, saved: list[list[float]]) -> None:
        """Take what `save` returned."""
        ...


class LowPass:
    """y_k = α y_{k−1} + (1 − α) x_k with α = exp(−Δt / τ), a first-order low-pass filter.

    time_constant: τ [s]. period: Δt [s]. Its delay at low frequency is Δt α / (1 − α), the slope
    of its phase at 0 (Oppenheim and Schafer, Discrete-Time Signal Processing, section 5.1).
    """

    def __init__(self, time_constant: float, period: float) -> None:
        self._keep = math.exp(-period / time_constant)
        self._last: Vector | None = None
        self.delay = period * self._keep / (1.0 - self._keep)

    def update(self, values: Vector) -> Vector:
        """See `Smoother`."""
        last = values if self._last is None else self._last
        self._last = self._keep * last + (1.0 - self._keep) * values
        return self._last

    def save(self) -> list[list[float]]:
        """See `Smoother`."""
        return [] if self._last is None else [self._last.tolist()]

    def restore(self, saved: list[list[float]]) -> None:
        """See `Smoother`."""
        self._last = np.array(saved[0]) if saved else None


class SavitzkyGolay:
    """Value, in the middle of a window, of the quadratic that fits its samples best.

    window: samples, odd. period: between two of them [s]. Its delay is half the window at every
    frequency (Savitzky and Golay, Analytical Chemistry 36, 1964). Until the window is full, its
    oldest sample stands for those before it.
    """

    def __init__(self, window: int, period: float) -> None:
        half = window // 2
        powers = np.vander(np.arange(-half, half + 1), 3, increasing=True)
        self._weights: Vector = np.linalg.pinv(powers)[0]
        self._samples: deque[Vector] = deque(maxlen=window)
        self.delay = half * period

    def update(self, values: Vector) -> Vector:
        """See `Smoother`."""
        if not self._samples:
            self._samples.extend([values] * len(self._weights))
        self._samples.append(values)
        return self._weights @ np.array(self._samples)

    def save(self) -> list[list[float]]:
        """See `Smoother`."""
        return [sample.tolist() for sample in self._samples]

    def restore(self, saved: list[list[float]]) -> None:
        """See `Smoother`."""
        self._samples.extend(np.array(sample) for sample in saved)


def delay_warning(smoother: Smoother | None) -> list[str]:
    """Return the warning that reports the delay; none without smoothing."""
    if smoother is None:
        return []
    return [f"smoothing delays the measurements by {smoother.delay * 1e3:.1f} ms"]


def make_smoother(
    smoothing: str, time_constant: float, window: int, period: float
) -> Smoother | None:
    """Return a filter as `SmoothingParams` describe it; None: no smoothing.

    period: between two measurements [s].
    """
    if smoothing == "low_pass":
        return LowPass(time_constant, period)
    return SavitzkyGolay(window, period) if smoothing == "savitzky_golay" else None
