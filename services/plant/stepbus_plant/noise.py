"""Random numbers of sensors, by counter: the n-th reading of a sensor has the same ones always."""

import zlib

import numpy as np


class Noise:
    """Random numbers of one sensor.

    seed: of the plant. sensor: its name; each has a stream of its own. Philox (Salmon et al.,
    Parallel random numbers: as easy as 1, 2, 3, 2011) computes them from a counter, so that what
    other sensors do, and whether this one was on before, changes none.
    """

    def __init__(self, seed: int, sensor: str) -> None:
        self._key = np.array([seed & (2**64 - 1), zlib.crc32(sensor.encode())], dtype=np.uint64)

    def at(self, number: int) -> np.random.Generator:
        """Return the generator of a reading; number: ≥ 0, such as a time [ns]."""
        counter = np.array([0, 0, number, 0], dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))
