"""What the sensors show of the true state: chosen quantities, noise, quantisation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from stepbus_schemas import JointState

from .errors import PhysicsError
from .params import Params

Values = Sequence[float]


class Sensors:
    """Turns true joint states into what is sensed.

    seed: of the noise; the same seed gives the same noise, whatever the machine.
    """

    def __init__(self, params: Params, names: Sequence[str], seed: int) -> None:
        self._names = list(names)
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._senses = [
            (
                quantity,
                self._chain(getattr(params.noise, quantity), getattr(params.resolution, quantity)),
            )
            for quantity in params.sense
        ]

    def _chain(self, noise: float, resolution: float | None) -> Callable[[Values], list[float]]:
        """Return the function from true to sensed values of one quantity."""
        if not noise and resolution is None:
            return list
        return lambda values: self._disturb(values, noise, resolution)

    def _disturb(self, values: Values, noise: float, resolution: float | None) -> list[float]:
        sensed = np.asarray(values)
        if noise:
            sensed = sensed + noise * self._random.standard_normal(len(sensed))
        if resolution is not None:
            sensed = resolution * np.round(sensed / resolution)
        return [float(value) for value in sensed]

    def sense(self, true: dict[str, Values], targets: list[float] | None) -> JointState:
        """Return what is sensed of true positions, velocities and efforts.

        Raises PhysicsError when the state has left the finite numbers.
        """
        positions = true["position"]
        if not math.isfinite(sum(positions) + sum(true["velocity"])):
            lost = [n for n, q in zip(self._names, positions, strict=True) if not math.isfinite(q)]
            raise PhysicsError(
                f"the simulation has diverged (joints {', '.join(lost) or 'by velocity'}); "
                "use a shorter physics_step or smaller gains"
            )
        sensed = {quantity: chain(true[quantity]) for quantity, chain in self._senses}
        return JointState(**sensed, target=targets)
