"""Random numbers of sensors, by counter: the n-th reading of a sensor has the same ones always."""

import zlib

import numpy as np


class Noise:
    """Random numbers for one purpose of one sensor.

    seed: of the plant. purpose: such as `odometry`; name: of the sensor. Each pair has a stream of
    its own, so that a base and a contact sensor may have the same name. Philox (Salmon et al.,
    Parallel random numbers: as easy as 1, 2, 3, 2011) computes them from a counter, so that what
    other sensors do, and whether this one was on before, changes none.
    """

    def __init__(self, seed: int, purpose: str, name: str = "") -> None:
        self._key = np.array(
            [seed & (2**64 - 1), zlib.crc32(f"{purpose}/{name}".encode())], dtype=np.uint64
        )

    def at(self, number: int) -> np.random.Generator:
        """Return the generator of a reading; number: ≥ 0, such as a time [ns]."""
        counter = np.array([0, 0, number, 0], dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))
