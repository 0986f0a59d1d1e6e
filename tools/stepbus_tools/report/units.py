"""Numbers as engineers read them: 0.1 mrad, not 1.0e-4 rad."""

import math
import re

_PREFIXES = ((1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_FROM = 0.1
"""Of a prefix: 0.1 mrad rather than 100 µrad."""
_TAKES = re.compile(r"(rad|m|N|J|V|A|W)(?![a-zA-Z])")
"""Units that take a prefix; seconds of a simulation are compared, so they have none."""
_KILO = "NJVAW"


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Return by what to multiply numbers up to a size, and the unit they have then."""
    size = abs(largest)
    if _TAKES.match(unit) and size > 0 and math.isfinite(size):
        for factor, prefix in _PREFIXES:
            least = factor if factor >= 1e3 else _FROM * factor
            if size >= least * (1 - 1e-9) and (factor < 1e3 or unit[0] in _KILO):
                return 1 / factor, prefix + unit
        return 1e9, f"n{unit}"
    return 1.0, unit


def engineering(value: float, unit: str) -> str:
    """Return a number of three digits with its unit."""
    factor, shown = prefixed(value, unit)
    return f"{value * factor:.3g} {shown}".strip()
