"""Distributions that values are drawn from, by SciPy's names."""

import ast
import re
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import need, suggest
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
        found = self.frozen.ppf(u)
        return [int(value) if self.is_discrete else float(value) for value in found]

    def probes(self) -> list[Any]:
        """Return values that tell whether a scenario takes such ones."""
        return list(self.choices) or self.values(np.array(_INSIDE))


def parse_distribution(given: str, text: str) -> Distribution:
    """Return the distribution that `name(…)` means; raises WiringError for one that cannot be.

    text: the axis, for the error.
    """
    found = _CALL.fullmatch(given)
    if found is None:
        raise WiringError(f"{text}: write a distribution as NAME(…), e.g. normal(1, 0.1)")
    name, (arguments, keywords) = found[1], _arguments(found[2] or "", text)
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
