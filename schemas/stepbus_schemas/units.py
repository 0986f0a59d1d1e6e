"""Units of fields as they are written: symbols of SI, and what engineers use beside them."""

import difflib
import re

_PREFIXES = "p n u µ μ m c d k M G T"
_PREFIXED = "m g s A K mol cd rad sr Hz N Pa J W C V F Ω H T Wb lm lx L l bar eV B bit ohm"
_ALONE = "min h d deg ° °C % - 1 px pixel rpm rev turn count tick step dB"
_SYMBOLS = {
    *_ALONE.split(),
    *_PREFIXED.split(),
    *(f"{prefix}{unit}" for prefix in _PREFIXES.split() for unit in _PREFIXED.split()),
}
_NAMES = {
    "newton": "N", "newtonmeter": "N·m", "newtonmetre": "N·m", "nm": "N·m", "meter": "m",
    "metre": "m", "millimeter": "mm", "millimetre": "mm", "second": "s", "sec": "s",
    "millisecond": "ms", "msec": "ms", "minute": "min", "hour": "h", "radian": "rad",
    "radians": "rad", "degree": "deg", "degrees": "deg", "volt": "V", "ampere": "A", "amp": "A",
    "watt": "W", "joule": "J", "pascal": "Pa", "hertz": "Hz", "kelvin": "K", "celsius": "°C",
    "gram": "g", "kilogram": "kg", "kilo": "kg", "tesla": "T", "liter": "L", "litre": "L",
    "percent": "%", "mps": "m/s", "kph": "km/h", "kmh": "km/h", "pixels": "pixel",
}  # fmt: skip
"""What people write → what they mean."""
_POWER = re.compile(r"(?:\^?[-+]?[0-9]+|[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+)$")
_SEPARATORS = re.compile(r"[·*/, ()]+")


def unit_problem(unit: str) -> str:
    """Return what is wrong with a unit such as `N·m/rad` or `m, m, rad`; nothing: it is one.

    What stands in braces, such as `{spins}`, is a unit of one's own.
    """
    bare = re.sub(r"\{[^{}]*\}", "1", unit)
    for part in filter(None, _SEPARATORS.split(bare)):
        symbol = part if part in _SYMBOLS else _POWER.sub("", part)
        if symbol not in _SYMBOLS:
            return (
                f"{part!r} is not a known unit{_hint(symbol)}; write SI symbols such as N, rad/s "
                f"or kg·m², or your own unit in braces: '{{spins}}'"
            )
    return ""


def _hint(symbol: str) -> str:
    name = symbol.lower()
    meant = _NAMES.get(name) or _NAMES.get(name.removesuffix("s"))
    near = difflib.get_close_matches(symbol, _SYMBOLS, n=1) if not meant else [meant]
    return f"; did you mean {near[0]!r}?" if near else ""
