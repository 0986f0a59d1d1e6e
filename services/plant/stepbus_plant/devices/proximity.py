"""A skin of capacitive sensors on the links of a robot: how far away it measures things."""

from collections.abc import Sequence

from stepbus_plant.params import ProximityErrors

from .sensors.noise import Noise

_CALIBRATION = 0
"""Number of the reading that draws what stays the same during a run; the others count from 1."""


class Skin:
    """Electrodes all over some links: each measures the nearest surface, wherever that is.

    links: those with a skin. errors: of its distances. random: numbers for that.
    """

    def __init__(self, links: Sequence[str], errors: ProximityErrors, random: Noise) -> None:
        self._noise, self._random = errors.noise, random
        gains = random.at(_CALIBRATION).normal(1.0, errors.gain, len(links)).tolist()
        self._gains: dict[str, float] = dict(zip(links, gains, strict=True))
        self._readings = _CALIBRATION

    def measure(self, links: Sequence[str], distances: Sequence[float]) -> list[float]:
        """Return what the skins of some links measure of these distances in a step [m], ≥ 0."""
        self._readings += 1
        if not links:
            return []
        noise = self._random.at(self._readings).normal(1.0, self._noise, len(links)).tolist()
        return [
            max(distance * self._gains[link] * factor, 0.0)
            for link, distance, factor in zip(links, distances, noise, strict=True)
        ]
