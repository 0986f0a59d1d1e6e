"""Joint sensors: selected quantities of the true state, with noise and quantisation."""

from collections.abc import Callable, Sequence

import numpy as np

from stepbus_plant.params import Params
from stepbus_schemas import JointState

Values = list[float]
"""One number per sensed joint."""


class Sensors:
    """Turns true joint states into sensor readings.

    seed: of the noise. Each quantity has its own random stream, so that the noise on one does not
    change the noise on another.
    """

    def __init__(self, params: Params, seed: int) -> None:
        self._random = [np.random.PCG64([seed, number]) for number in range(3)]

        def make(number: int, quantity: str) -> Callable[[Values], Values | None]:
            return _sensor(params, quantity, np.random.Generator(self._random[number]))

        self._position = make(0, "position")
        self._velocity = make(1, "velocity")
        self._effort = make(2, "effort")

    def sense(
        self, position: Values, velocity: Values, effort: Values, target: Values | None
    ) -> JointState:
        """Return the readings of true positions, velocities and efforts; targets have no noise."""
        return JointState(
            position=self._position(position),
            velocity=self._velocity(velocity),
            effort=self._effort(effort),
            target=target,
        )

    def save(self) -> list[tuple[str, str]]:
        """Return how far each random stream is, for a checkpoint."""
        states = [random.state["state"] for random in self._random]
        return [(str(state["state"]), str(state["inc"])) for state in states]

    def restore(self, saved: Sequence[tuple[str, str]]) -> None:
        """Take what `save` returned."""
        for random, (state, increment) in zip(self._random, saved, strict=True):
            full = random.state
            full["state"] = {"state": int(state), "inc": int(increment)}
            random.state = full


def _sensor(
    params: Params, quantity: str, random: np.random.Generator
) -> Callable[[Values], Values | None]:
    """Return the function from true to sensed values of one quantity."""
    noise: float = getattr(params.noise, quantity)
    resolution: float | None = getattr(params.resolution, quantity)

    def disturbed(values: Values) -> Values:
        sensed = np.asarray(values)
        if noise:
            sensed = sensed + noise * random.standard_normal(len(values))
        if resolution is not None:
            sensed = resolution * np.round(sensed / resolution)
        return [float(value) for value in sensed]

    if quantity not in params.sense:
        return lambda _: None
    return disturbed if noise or resolution is not None else lambda values: values
