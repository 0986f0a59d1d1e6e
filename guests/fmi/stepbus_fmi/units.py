"""Units: of a model description, of messages, and as a scenario writes them."""

import re
from collections.abc import Iterable
from functools import cache
from math import isfinite
from typing import Any

from stepbus_participant import need
from stepbus_schemas import WiringError, error_text

_NAMES = {
    "kilogram": "kg",
    "meter": "m",
    "second": "s",
    "ampere": "A",
    "kelvin": "K",
    "mole": "mol",
    "candela": "cd",
}
"""Base units that are compared. Models are not exact about angles: N·m is N·m/rad."""
_Unit = tuple[float, float, dict[str, int]]
"""Factor and offset to SI, and the powers of the base units."""


@cache
def registry() -> Any:
    """Return pint's units. The first call takes a second, too long within a step."""
    (pint,) = need("units of an FMU", "pint")
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


class Units:
    """The units that a file defines, as FMPy reads them; others are pint's."""

    def __init__(self, defined: Iterable[Any], file: str) -> None:
        self._own: dict[str, _Unit] = {}
        for unit in defined:
            base = unit.baseUnit
            if base is None:
                continue
            for one in (base, *unit.displayUnits):
                if not isfinite(one.factor) or not one.factor:
                    text = f"{file}: the factor of unit {unit.name!r} is {one.factor:g}"
                    raise WiringError(f"{text}, which is no number to convert by")
            powers = {key: power for key in _NAMES.values() if (power := getattr(base, key))}
            self._own[unit.name] = base.factor, base.offset, powers
            for shown in unit.displayUnits:
                # FMI: value in the display unit = factor · value + offset
                inverse = base.factor / shown.factor
                self._own[shown.name] = inverse, base.offset - inverse * shown.offset, powers

    def conversion(
        self, given: str, wanted: str, others: "Units | None" = None
    ) -> tuple[float, float]:
        """Return factor and offset from one unit to another. others: those that know the second.

        given: a field whose unit depends on a mode has several, with commas; the one that fits
        counts. Raises WiringError for units of different dimensions, or unknown ones.
        """
        if given == wanted or not given or not wanted:
            return 1.0, 0.0
        other, shift, needed = (others or self)._of(wanted)
        for unit in given.split(", "):
            factor, offset, powers = self._of(unit)
            if powers == needed:
                return factor / other, (offset - shift) / other
        raise WiringError(f"unit {given!r} is no {wanted!r}: they measure different quantities")

    def _of(self, unit: str) -> _Unit:
        if unit not in self._own:
            self._own[unit] = _by_pint(unit)
        return self._own[unit]


def _by_pint(unit: str) -> _Unit:
    text = unit.replace("·", "*").replace("²", "**2").replace("³", "**3").strip("[]")
    # Modelica has `W/(m2.K)`.
    text = re.sub(r"(?<=[A-Za-z])-?\d+", r"**\g<0>", text.replace(".", "*"))
    if text in ("-", "1"):
        return 1.0, 0.0, {}
    try:
        known = registry()
        zero, one = (known.Quantity(value, text).to_base_units() for value in (0, 1))
        powers = {_NAMES[name]: int(p) for name, p in one.unit_items() if name != "radian"}
    except Exception as exc:  # pint's parser raises what Python's does
        raise WiringError(f"unknown unit {unit!r}: {error_text(exc)}") from exc
    return float(one.magnitude - zero.magnitude), float(zero.magnitude), powers
