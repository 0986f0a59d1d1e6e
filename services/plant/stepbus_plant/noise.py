"""Random numbers of the plant: those of one reading, and errors that go on from one to the next."""

import hashlib
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from stepbus_plant.geometry import Array
from stepbus_plant.memory import Remembers


class Noise:
    """Random numbers for one purpose of one sensor.

    seed: of the plant. purpose: such as `odometry`; name: of the sensor. Each pair has a stream of
    its own, so that a base and a contact sensor may have the same name. Philox (Salmon et al.,
    Parallel random numbers: as easy as 1, 2, 3, 2011) computes them from a counter, so that what
    other sensors do, and whether this one was on before, changes none.
    """

    def __init__(self, seed: int, purpose: str, name: str = "") -> None:
        key = [seed & (2**64 - 1), zlib.crc32(f"{purpose}/{name}".encode())]
        # Made once: a new generator draws entropy first, which takes longer than a few numbers.
        self._random = np.random.Philox(key=np.array(key, dtype=np.uint64))
        self._generator = np.random.Generator(self._random)
        self._start: Any = self._random.state
        self._counter = self._start["state"]["counter"]
        self._counter[:] = 0

    def at(self, number: int) -> np.random.Generator:
        """Return the generator of a reading, until the next call; number: ≥ 0, as a time [ns]."""
        self._counter[2] = number
        self._random.state = self._start
        return self._generator


class Errors(Remembers):
    """Adds noise and bias to readings of one quantity.

    seed: of its random numbers. noise: standard deviation of each reading. bias: standard deviation
    of the offset, drawn once, shape (count,).
    """

    def __init__(
        self, seed: Sequence[int], noise: float, bias: float = 0.0, count: int = 0
    ) -> None:
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._bias: Array = bias * self._random.standard_normal(count)
        self._is_biased = bool(self._bias.any())
        self._noise = noise

    def save(self) -> Any:
        """Return how far the random numbers are."""
        state = self._random.bit_generator.state["state"]
        return str(state["state"]), str(state["inc"])

    def restore(self, saved: Any) -> None:
        """Take a state from `save`."""
        random, (state, increment) = self._random.bit_generator, saved
        random.state = {**random.state, "state": {"state": int(state), "inc": int(increment)}}

    def disturb(self, values: Sequence[float] | Array) -> Array:
        """Return a reading of true values, shape (count,)."""
        disturbed: Array = np.asarray(values, dtype=np.float64)
        if self._is_biased:
            disturbed = disturbed + self._bias
        if self._noise:
            disturbed = disturbed + self._noise * self._random.standard_normal(len(disturbed))
        return disturbed


def seed_of(seed: int, stream: str) -> list[int]:
    """Return the seed of a stream of random numbers; seed: of the plant. stream: its name."""
    digest = hashlib.sha256(stream.encode()).digest()
    return [seed, *(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))]
