"""Errors of a sensor: noise, and an offset that is constant during a run."""

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Errors:
    """Adds noise and bias to readings of one quantity.

    seed: of the plant. stream: names the quantity; each has random numbers of its own. noise:
    standard deviation of each reading. bias: standard deviation of the offset, drawn once.
    """

    def __init__(self, seed: int, stream: str, noise: float, bias: float, count: int) -> None:
        digest = hashlib.sha256(stream.encode()).digest()
        keys = [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4)]
        self._random = np.random.Generator(np.random.PCG64([seed, *keys]))
        offset = self._random.standard_normal(count)
        self._bias: Array = bias * offset
        self._noise = noise

    def disturb(self, values: Sequence[float] | Array) -> Array:
        """Return a reading of true values, shape (count,)."""
        disturbed: Array = np.asarray(values, dtype=np.float64)
        disturbed = disturbed + self._bias if self._bias.any() else disturbed
        return (
            disturbed + self._noise * self._random.standard_normal(len(disturbed))
            if self._noise
            else disturbed
        )
