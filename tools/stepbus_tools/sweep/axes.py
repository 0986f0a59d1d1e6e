"""The axes of a sweep, and which runs they make: grids, draws and repeats."""

import ast
import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import SettingsError, need, suggest
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

FAULTS = "faults"
"""The axis whose values are faults to inject; `none`: no fault."""
_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_RANGE = re.compile(rf"{_NUMBER}:{_NUMBER}(?::\s*(\d+)\s*)?(?::\s*(log|lin)\s*)?")
_AXIS = re.compile(r"([\w.\-/ \[\]]+?)\s*([=~])\s*(\S.*)", re.DOTALL)
_ALIASES = {"normal": "norm", "exponential": "expon"}
_CHOICE = "choice"
_INSIDE = (0.001, 0.5, 0.999)
_MOST_VALUES = 100_000
_MOST_PROBED = 200
Values = tuple[tuple[Any, ...], ...]
"""One row a point, one value a path."""


@dataclass(frozen=True)
class Distribution:
    """A frozen distribution of SciPy, or a choice of values, all as likely.

    choices: its values; none of a distribution of numbers.
    """

    frozen: Any
    is_discrete: bool = False
    choices: tuple[Any, ...] = ()

    def values(self, u: NDArray[np.float64]) -> list[Any]:
        """Return the values at points between 0 and 1, shape (n,)."""
        if self.choices:
            last = len(self.choices) - 1
            return [self.choices[min(int(at * (last + 1)), last)] for at in u]
        values = self.frozen.ppf(u)
        return [int(value) if self.is_discrete else float(value) for value in values]


@dataclass(frozen=True, kw_only=True)
class Span:
    """All numbers between two, for an optimizer.

    is_whole: only whole ones; a parameter that takes others makes it false (`spec.plan`).
    """

    low: float
    high: float
    is_log: bool
    is_whole: bool


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What varies together, and over what.

    paths: of the values, as `--set` has them. values: none of an axis that is drawn or free.
    distribution: what its values are drawn from. span: what an optimizer chooses from. is_log: its
    values are a logarithmic range.
    """

    text: str
    paths: tuple[str, ...]
    values: Values = ()
    distribution: Distribution | None = None
    span: Span | None = None
    is_log: bool = False

    def probes(self) -> Values:
        """Return values that tell whether a scenario takes such ones: all where they are few."""
        if self.span is not None:
            ends = (self.span.low, self.span.high)
            return tuple((int(end) if self.span.is_whole else end,) for end in ends)
        if self.distribution is not None:
            drawn = self.distribution
            return tuple((v,) for v in drawn.choices or drawn.values(np.array(_INSIDE)))
        has_texts = any(all(isinstance(value, str) for value in row) for row in self.values)
        if has_texts or self.paths == (FAULTS,):
            return self.values[:_MOST_PROBED]
        return self.values[0], self.values[-1]


def parse_axis(text: str) -> Axis:
    """Return the axis that a text means; raises WiringError for one that means none."""
    parts = [_parse_one(part.strip(), text) for part in text.split(" & ")]
    if len(parts) == 1:
        return parts[0]
    if any(not part.values for part in parts):
        raise WiringError(f"{text}: only lists and ranges with a count can vary together")
    lengths = {part.paths[0]: len(part.values) for part in parts}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{path} has {count}" for path, count in lengths.items())
        raise WiringError(f"{text}: axes joined by & need equally many values; {counts}")
    rows = zip(*(part.values for part in parts), strict=True)
    values = tuple(tuple(value for (value,) in row) for row in rows)
    is_log = any(part.is_log for part in parts)
    return Axis(text=text, paths=tuple(lengths), values=values, is_log=is_log)


def _parse_one(part: str, text: str) -> Axis:
    match = _AXIS.match(part)
    if match is None:
        raise WiringError(
            f"{text}: write PATH=VALUES or PATH~DISTRIBUTION, e.g. controller.params.kp=50:200:7 "
            "or plant.params.mass~normal(1, 0.1)"
        )
    path, sign, rest = match[1], match[2], match[3].strip()
    if sign == "~":
        return Axis(text=text, paths=(path,), distribution=parse_distribution(rest, text))
    span = _RANGE.fullmatch(rest)
    if span is not None:
        return _ranged(path, span, text)
    try:
        values = parse_yaml(text, f"[{rest}]")
    except SettingsError as exc:
        raise WiringError(f"{text}: the values are not a YAML list: {exc}") from exc
    if not values:
        raise WiringError(f"{text}: give at least one value")
    return Axis(text=text, paths=(path,), values=tuple((value,) for value in values))


def _ranged(path: str, match: re.Match[str], text: str) -> Axis:
    low, high = float(match[1]), float(match[2])
    is_whole = all(re.fullmatch(r"[-+]?\d+", match[n]) for n in (1, 2))
    is_log = match[4] == "log"
    if is_log and not (low > 0 and high > 0):
        raise WiringError(f"{text}: both ends of a logarithmic range must be above 0")
    if match[3] is None:
        if not low < high:
            raise WiringError(f"{text}: the start of a range must be below its end")
        ends_are_whole = low.is_integer() and high.is_integer()
        span = Span(low=low, high=high, is_log=is_log, is_whole=ends_are_whole)
        return Axis(text=text, paths=(path,), span=span, is_log=is_log)
    count = int(match[3])
    if not 0 < count <= _MOST_VALUES:
        raise WiringError(f"{text}: a range must have 1 to {_MOST_VALUES} values, not {count}")
    numbers: Sequence[float] = (
        np.geomspace(low, high, count) if is_log else np.linspace(low, high, count)
    ).tolist()
    # Numbers are whole ones where all are, and the ends are written so.
    if is_whole and all(math.isclose(value, round(value), abs_tol=1e-9) for value in numbers):
        numbers = list(map(round, numbers))
    return Axis(text=text, paths=(path,), values=tuple((n,) for n in numbers), is_log=is_log)


def parse_distribution(given: str, text: str) -> Distribution:
    """Return the distribution that `name(…)` means; raises WiringError for one that cannot be.

    text: the axis, for the error.
    """
    try:
        node = ast.parse(given, mode="eval").body
        call = node if isinstance(node, ast.Call) else ast.Call(node, [], [])
        name = cast("ast.Name", call.func).id
        arguments = [ast.literal_eval(value) for value in call.args]
        keywords = {str(item.arg): ast.literal_eval(item.value) for item in call.keywords}
    except (AttributeError, SyntaxError, ValueError) as exc:
        raise WiringError(
            f"{text}: write a distribution as NAME(…), e.g. normal(1, 0.1); its arguments must be "
            "numbers or quoted strings"
        ) from exc
    if name == _CHOICE:
        if not arguments or keywords:
            raise WiringError(f"{text}: choice needs its values, e.g. choice('a', 'b')")
        return Distribution(None, choices=tuple(arguments))
    return _of_scipy(_ALIASES.get(name, name), arguments, keywords, text)


def _of_scipy(name: str, arguments: list[Any], keywords: dict[str, Any], text: str) -> Distribution:
    (stats,) = need("a sweep over a distribution", "scipy.stats")
    known = [one for one in dir(stats) if hasattr(getattr(stats, one), "ppf")]
    if name not in known:
        more = suggest(name, [*known, *_ALIASES, _CHOICE])
        raise WiringError(f"{text}: SciPy has no distribution {name!r}{more}")
    try:
        frozen = getattr(stats, name)(*arguments, **keywords)
        probes = frozen.ppf(_INSIDE)
    except (TypeError, ValueError) as exc:
        raise WiringError(f"{text}: {exc}") from exc
    if not np.all(np.isfinite(probes)):
        raise WiringError(f"{text}: {name} does not accept these parameters")
    return Distribution(frozen, is_discrete=isinstance(getattr(stats, name), stats.rv_discrete))


Sampling = Literal["random", "latin", "sobol", "halton"]
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
        sampling: Sampling = "random",
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
        raise WiringError("a distribution needs --samples, the number of samples, e.g. 100")
    if samples and not is_drawn:
        raise WiringError("samples: no axis has a distribution; for several seeds use --repeats")


def _points(count: int, width: int, sampling: Sampling, seed: int) -> NDArray[np.float64]:
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
