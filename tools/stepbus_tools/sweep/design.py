"""Which runs a sweep makes: the product of its grids, its draws and its repeats."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.errors import argument
from stepbus_participant import need
from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import Axis

SAMPLINGS = ("random", "latin", "sobol", "halton")
SEED = "seed"


@dataclass(frozen=True)
class Point:
    """One run of a sweep: its number, and path → value."""

    number: int
    values: Mapping[str, Any]


class Design:
    """The points of a sweep, the same for the same arguments, each made when it is asked for.

    Every combination of the grids gets the same draws, so that what differs between two of them
    is no chance. repeats: runs of each point, with seeds from `first_seed` on.

    Raises WiringError for axes that do not go together.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        *,
        samples: int = 0,
        sampling: str = "random",
        seed: int = 0,
        repeats: int = 1,
        first_seed: int = 0,
    ) -> None:
        _check(axes, samples, repeats)
        self._grids = [axis for axis in axes if axis.values]
        self._sizes = [len(axis.values) for axis in self._grids]
        self._repeats, self._first_seed = repeats, first_seed
        drawn = {axis.paths[0]: axis.distribution for axis in axes if axis.distribution}
        self._samples = samples if drawn else 1
        self._draws: dict[str, list[Any]] = {}
        if drawn:
            # At the very ends most distributions are infinite.
            points = np.clip(_points(samples, len(drawn), sampling, seed), 1e-12, 1 - 1e-12)
            columns = zip(drawn.items(), points.T, strict=True)
            self._draws = {path: values.values(column) for (path, values), column in columns}
        self.paths = [path for axis in axes for path in axis.paths]
        if repeats > 1:
            self.paths.append(SEED)

    def __len__(self) -> int:
        """Return the number of runs."""
        return prod(self._sizes) * self._samples * self._repeats

    def __getitem__(self, number: int) -> Point:
        """Return the point of a number."""
        if not 0 <= number < len(self):
            raise IndexError(number)
        rest, repeat = divmod(number, self._repeats)
        rest, sample = divmod(rest, self._samples)
        places = np.unravel_index(rest, self._sizes) if self._sizes else ()
        values: dict[str, Any] = {}
        for axis, place in zip(self._grids, places, strict=True):
            values |= zip(axis.paths, axis.values[int(place)], strict=True)
        values |= {path: row[sample] for path, row in self._draws.items()}
        if self._repeats > 1:
            values[SEED] = self._first_seed + repeat
        return Point(number, {path: values[path] for path in self.paths})

    def __iter__(self) -> Iterator[Point]:
        """Yield all points in order."""
        return (self[number] for number in range(len(self)))


def _check(axes: Sequence[Axis], samples: int, repeats: int) -> None:
    paths = [path for axis in axes for path in axis.paths]
    twice = sorted({path for path in paths if paths.count(path) > 1})
    if twice:
        raise WiringError(f"{', '.join(twice)}: on two axes")
    if repeats > 1 and SEED in paths:
        raise WiringError("seed: use either an axis or repeats, not both")
    is_drawn = any(axis.distribution is not None for axis in axes)
    if is_drawn and samples < 1:
        raise WiringError(
            f"a distribution needs {argument('--samples')}, the number of samples, e.g. 100"
        )
    if samples and not is_drawn:
        raise WiringError(
            f"samples: no axis has a distribution; for several seeds use {argument('--repeats')}"
        )


def _points(count: int, width: int, sampling: str, seed: int) -> NDArray[np.float64]:
    """Return points between 0 and 1, shape (count, width)."""
    random = np.random.default_rng(seed)
    if sampling == "random":
        return random.random((count, width))
    (qmc,) = need("such a sampling", "scipy.stats.qmc")
    makers = {"latin": qmc.LatinHypercube, "sobol": qmc.Sobol, "halton": qmc.Halton}
    with warnings.catch_warnings():
        # Sobol points are balanced only where their number is a power of 2: the docs say so.
        warnings.simplefilter("ignore", UserWarning)
        points: NDArray[np.float64] = makers[sampling](width, rng=random).random(count)
    return points
