"""Durations as a scenario has them: `5ms`, `0.005s`, `1/200s`, as whole nanoseconds."""

import re

from stepbus_schemas import WiringError

_UNITS_NS = {
    "ns": 1,
    "us": 10**3,
    "µs": 10**3,  # MICRO SIGN
    "μs": 10**3,  # GREEK SMALL LETTER MU
    "ms": 10**6,
    "s": 10**9,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
}
LONGEST_NS = 2**63 - 1
"""What fits a signed 64-bit integer, as MCAP and other languages keep time: 292 years."""

_FORM = re.compile(r"([0-9]{1,19}(?:\.[0-9]{1,19})?)(?:/([1-9][0-9]{0,18}))? *([a-zµμ]+)")
_WRITTEN = ("s", "ms", "us", "ns")


def parse_duration(text: str, *, may_be_zero: bool = False) -> int:
    """Return a duration such as `5ms`, `0.005s` or `1/200s` in [ns].

    may_be_zero: `0s` is one as well. Raises WiringError when it has no unit, is not positive, is
    longer than 292 years, or is no whole number of nanoseconds, then with the nearest one that is.
    """
    form = _FORM.fullmatch(text.strip())
    if form is None or form[3] not in _UNITS_NS:
        raise WiringError(
            f"{text!r} is not a duration; write a number with a unit (ns, us, ms, s, min or h), "
            "e.g. 5ms"
        )
    # Most participants read none.
    from fractions import Fraction  # noqa: PLC0415

    exact = Fraction(form[1]) / int(form[2] or 1) * _UNITS_NS[form[3]]
    if exact > LONGEST_NS:
        raise WiringError(f"{text!r} is longer than 2^63 − 1 ns (292 years)")
    if exact.denominator != 1:
        near = format_duration(max(1, round(exact)))
        raise WiringError(
            f"{text!r} is {float(exact):.16g} ns, not a whole number of nanoseconds; "
            f"the nearest is {near}"
        )
    if exact == 0 and not may_be_zero:
        raise WiringError(f"{text!r} must be longer than 0")
    return int(exact)


def whole_steps(text: str, step_ns: int) -> int:
    """Return how many steps a duration such as `5ms` is; step_ns: their length [ns].

    Raises WiringError when it is no duration, or no whole number of steps: with the nearest.
    """
    time_ns = parse_duration(text)
    steps, rest = divmod(time_ns, step_ns)
    if rest:
        near = [n * step_ns for n in (steps, steps + 1) if 0 < n * step_ns <= LONGEST_NS]
        raise WiringError(
            f"{text} is {time_ns / step_ns:.6g} steps of "
            f"{format_duration(step_ns)}, not a whole number; the nearest is "
            f"{' or '.join(map(format_duration, near))}"
        )
    return steps


def format_duration(duration_ns: int) -> str:
    """Return a duration in the largest of s, ms, us and ns that makes it a whole number."""
    unit = next(unit for unit in _WRITTEN if duration_ns % _UNITS_NS[unit] == 0)
    return f"{duration_ns // _UNITS_NS[unit]}{unit}"
