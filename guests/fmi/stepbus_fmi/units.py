"""Units: of a model description, of messages, and as a scenario writes them."""

import re
from functools import cache
from typing import Any

from stepbus_participant import need
from stepbus_schemas import WiringError, error_text

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
"""Base units that are compared. Models are not exact about angles: N·m is N·m/rad."""
_NAMES = ("kilogram", "meter", "second", "ampere", "kelvin", "mole", "candela")
_PINT = dict(zip(_NAMES, _BASES, strict=True))


@cache
def registry() -> Any:
    """Return pint's units. The first call takes a second, too long within a step."""
    (pint,) = need("units of an FMU", "pint")
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


class Units:
    """The units of an FMU: name → factor and offset to SI, and dimension; others are pint's."""

    def __init__(self, description: Any) -> None:
        self._own: dict[str, tuple[float, float, dict[str, int]]] = {}
        for unit in description.unitDefinitions:
            base = unit.baseUnit
            if base is None:
                continue
            powers = {key: int(getattr(base, key) or 0) for key in _BASES}
            powers = {key: power for key, power in powers.items() if power}
            factor, offset = float(base.factor), float(base.offset)
            self._own[unit.name] = factor, offset, powers
            for shown in unit.displayUnits:
                # FMI: value in the display unit = factor · value + offset
                inverse = factor / float(shown.factor)
                self._own[shown.name] = inverse, offset - inverse * float(shown.offset), powers

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

    def _of(self, unit: str) -> tuple[float, float, dict[str, int]]:
        if unit not in self._own:
            self._own[unit] = _by_pint(unit)
        return self._own[unit]


def _by_pint(unit: str) -> tuple[float, float, dict[str, int]]:
    """Return factor and offset to SI, and the powers of the base units."""
    text = unit.replace("·", "*").replace("²", "**2").replace("³", "**3").strip("[]")
    # Modelica has `W/(m2.K)`.
    text = re.sub(r"(?<=[A-Za-z])-?\d+", r"**\g<0>", text.replace(".", "*"))
    if text in ("-", "1"):
        return 1.0, 0.0, {}
    try:
        known = registry()
        zero, one = (known.Quantity(value, text).to_base_units() for value in (0, 1))
        powers = {_PINT[name]: int(p) for name, p in one.unit_items() if name != "radian"}
    except Exception as exc:  # pint's parser raises what Python's does
        raise WiringError(f"unknown unit {unit!r}: {error_text(exc)}") from exc
    return float(one.magnitude - zero.magnitude), float(zero.magnitude), powers
