"""The axes of a sweep: the values of a parameter, or how they are drawn."""

import ast
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import SettingsError, need, suggest
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_CALL = re.compile(r"(\w+)\s*(?:\((.*)\))?", re.DOTALL)
_ALIASES = {"normal": "norm", "exponential": "expon"}
_CHOICE = "choice"
_INSIDE = (0.001, 0.5, 0.999)


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

    def probes(self) -> list[Any]:
        """Return values that tell whether a scenario takes such ones."""
        return list(self.choices) or self.values(np.array(_INSIDE))


def parse_distribution(given: str, text: str) -> Distribution:
    """Return the distribution that `name(…)` means; raises WiringError for one that cannot be.

    text: the axis, for the error.
    """
    match = _CALL.fullmatch(given)
    if match is None:
        raise WiringError(f"{text}: write a distribution as NAME(…), e.g. normal(1, 0.1)")
    name, (arguments, keywords) = match[1], _arguments(match[2] or "", text)
    if name == _CHOICE:
        if not arguments or keywords:
            raise WiringError(f"{text}: choice needs its values, e.g. choice('a', 'b')")
        return Distribution(None, choices=tuple(arguments))
    return _of_scipy(_ALIASES.get(name, name), arguments, keywords, text)


def _arguments(given: str, text: str) -> tuple[list[Any], dict[str, Any]]:
    try:
        call = cast("ast.Call", ast.parse(f"f({given})", mode="eval").body)
        values = [ast.literal_eval(value) for value in call.args]
        return values, {str(item.arg): ast.literal_eval(item.value) for item in call.keywords}
    except (AttributeError, SyntaxError, ValueError) as exc:
        raise WiringError(f"{text}: {given!r} are no numbers or texts in quotes") from exc


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
        raise WiringError(f"{text}: {name} cannot have these parameters: no value can be drawn")
    return Distribution(frozen, is_discrete=isinstance(getattr(stats, name), stats.rv_discrete))


_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_RANGE = re.compile(rf"{_NUMBER}:{_NUMBER}(?::\s*(\d+)\s*)?(?::\s*(log|lin)\s*)?")
_MOST_VALUES = 100_000
FAULTS = "faults"
"""The axis whose values are faults to inject; `none`: no fault."""


@dataclass(frozen=True, kw_only=True)
class Span:
    """All numbers between two, for an optimizer; whole ones where both ends are."""

    low: float
    high: float
    is_log: bool = False
    is_whole: bool = False


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What varies together, and over what.

    paths: of the values, as `--set` has them. values: one row a point, one value a path; none of
    an axis that is drawn or free. distribution: what its values are drawn from. span: what an
    optimizer chooses from.
    """

    text: str
    paths: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...] = ()
    distribution: Distribution | None = None
    span: Span | None = None


def parse_axis(text: str) -> Axis:
    """Return the axis that a text means; raises WiringError for one that means none."""
    parts = [_parse_one(part.strip(), text) for part in text.split(" & ")]
    if len(parts) == 1:
        return parts[0]
    if any(not part.values for part in parts):
        raise WiringError(f"{text}: only lists and ranges with a count vary together")
    lengths = {part.paths[0]: len(part.values) for part in parts}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{path} has {count}" for path, count in lengths.items())
        raise WiringError(f"{text}: values that vary together need the same number; {counts}")
    rows = zip(*(part.values for part in parts), strict=True)
    values = tuple(tuple(value for (value,) in row) for row in rows)
    return Axis(text=text, paths=tuple(part.paths[0] for part in parts), values=values)


def _parse_one(part: str, text: str) -> Axis:
    match = re.match(r"([\w.\-/ ]+?)\s*([=~])(.*)", part, re.DOTALL)
    if match is None or not match[3].strip():
        raise WiringError(
            f"{text}: write PATH=VALUES or PATH~DISTRIBUTION, e.g. controller.params.kp=50:200:7 "
            "or plant.params.mass~normal(1, 0.1)"
        )
    path, sign, rest = match[1], match[2], match[3].strip()
    if sign == "~":
        return Axis(text=text, paths=(path,), distribution=parse_distribution(rest, text))
    span = _RANGE.fullmatch(rest)
    if span is None:
        return Axis(text=text, paths=(path,), values=_listed(rest, text))
    return _ranged(path, span, text)


def _listed(rest: str, text: str) -> tuple[tuple[Any, ...], ...]:
    try:
        values = parse_yaml(text, f"[{rest}]")
    except SettingsError as exc:
        raise WiringError(f"{text}: the values are no list of YAML: {exc}") from exc
    if not values:
        raise WiringError(f"{text}: give at least one value")
    return tuple((value,) for value in values)


def _ranged(path: str, match: re.Match[str], text: str) -> Axis:
    low, high = float(match[1]), float(match[2])
    is_whole = all(re.fullmatch(r"[-+]?\d+", match[n]) for n in (1, 2))
    is_log = match[4] == "log"
    if is_log and not (low > 0 and high > 0):
        raise WiringError(f"{text}: a logarithmic range lies above 0")
    if match[3] is None:
        if not low < high:
            raise WiringError(f"{text}: the range starts below its end")
        span = Span(low=low, high=high, is_log=is_log, is_whole=is_whole)
        return Axis(text=text, paths=(path,), span=span)
    count = int(match[3])
    if not 0 < count <= _MOST_VALUES:
        raise WiringError(f"{text}: a range has 1 to {_MOST_VALUES} values, not {count}")
    numbers = np.geomspace(low, high, count) if is_log else np.linspace(low, high, count)
    return Axis(text=text, paths=(path,), values=_numbers(numbers.tolist(), is_whole=is_whole))


def _numbers(values: Sequence[float], *, is_whole: bool) -> tuple[tuple[Any, ...], ...]:
    """Return numbers as values: whole ones where all are, and the ends are written so."""
    if is_whole and all(math.isclose(value, round(value), abs_tol=1e-9) for value in values):
        return tuple((round(value),) for value in values)
    return tuple((value,) for value in values)
