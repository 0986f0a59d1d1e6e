"""What the sensors make of the true state: noise first, then quantisation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from numpy.random import PCG64, Generator

from stepbus_schemas import JointState

from .params import Noise, Quantity, Resolution

_QUANTITIES: tuple[Quantity, ...] = ("position", "velocity", "effort")
Measure = Callable[[list[float]], list[float] | None]


class Sensor:
    """One quantity of all joints, with Gaussian noise and finite resolution.

    deviation: standard deviation of the noise; resolution: distance between two readings; both in
    the quantity's unit. Each quantity draws from a generator of its own, so that noise on one
    does not change that on another.
    """

    def __init__(self, deviation: float, resolution: float | None, seed: Sequence[int]) -> None:
        self._deviation = deviation
        self._resolution = resolution
        self._random = Generator(PCG64(seed))

    def measure(self, true: list[float]) -> list[float]:
        """Return readings of the true values, shape (n,)."""
        values = true
        if self._deviation:
            noise = self._random.normal(0.0, self._deviation, len(true)).tolist()
            values = [value + error for value, error in zip(true, noise, strict=True)]
        if self._resolution:
            unit = self._resolution
            values = [math.floor(value / unit + 0.5) * unit for value in values]
        return values


class Sensing:
    """All sensors of a plant.

    sense: quantities that are sensed; the others stay absent. seed: of the run, for this plant.
    """

    def __init__(
        self, *, sense: Sequence[Quantity], noise: Noise, resolution: Resolution, seed: int
    ) -> None:
        measures = [
            _measure(name in sense, getattr(noise, name), getattr(resolution, name), (seed, place))
            for place, name in enumerate(_QUANTITIES)
        ]
        self._position, self._velocity, self._effort = measures

    def measure(
        self, position: list[float], velocity: list[float], effort: list[float]
    ) -> JointState:
        """Return what the sensors read; each vector of shape (n,) [rad, rad/s, N·m]."""
        return JointState(
            position=self._position(position),
            velocity=self._velocity(velocity),
            effort=self._effort(effort),
        )


def _measure(
    sensed: bool, deviation: float, resolution: float | None, seed: tuple[int, int]
) -> Measure:
    if not sensed:
        return _nothing
    if deviation or resolution:
        return Sensor(deviation, resolution, seed).measure
    return _all


def _nothing(_true: list[float]) -> None:
    return None


def _all(true: list[float]) -> list[float]:
    return true
