"""Start values as a scenario writes them."""

from collections.abc import Mapping
from functools import partial
from math import isfinite
from typing import Any

from stepbus_participant import Problems
from stepbus_participant.parameters import Keys, show
from stepbus_schemas import WiringError, suggest

from .model import Model, Variable, named
from .units import Units

_SETTABLE = ("exact", "approx")


def start_values(
    model: Model, units: Units, given: Mapping[str, Any], problems: Problems
) -> dict[str, Any]:
    """Return variable → value, as the FMU takes it; adds what is wrong to the problems."""
    found = {}
    for name, value in named(given).items():
        keys: Keys = ("start", name)
        read = problems.attempt(keys, partial(_read, model, units, name, value))
        if read is not None:
            found[name] = read
    return found


def _read(model: Model, units: Units, name: str, value: Any) -> Any:
    item = model.find(name)
    if item.causality != "input" and item.initial not in _SETTABLE:
        what = f"{item.variability} {item.causality}"
        raise WiringError(f"{name} is a {what} variable that the FMU computes; it cannot be set")
    if not item.shape:
        return read_value(item, value, units)
    values = _flat(value)
    if len(values) != item.size:
        shape = " × ".join(map(str, item.shape))
        raise WiringError(f"{name} has {item.size} values ({shape}), not {len(values)}")
    return [read_value(item, one, units) for one in values]


def _flat(value: Any) -> list[Any]:
    if not isinstance(value, list | tuple):
        return [value]
    return [one for part in value for one in _flat(part)]


def read_value(item: Variable, value: Any, units: Units) -> Any:
    """Return one value of a variable; raises WiringError for one that it cannot have."""
    kind = item.kind
    if kind is float:
        return _number(item, value, units)
    if kind is int and isinstance(value, str):
        items = dict(item.items)
        if value in items:
            return items[value]
        raise WiringError(f"{item.name} has no item {value!r}{suggest(value, items)}")
    if kind is bytes and isinstance(value, str):
        try:
            return bytes.fromhex(value)
        except ValueError as exc:
            raise WiringError(f"{item.name} takes bytes in hexadecimal, not {value!r}") from exc
    if type(value) is not kind:
        raise WiringError(f"{item.name} is {_a(item)}, not {show(value)}")
    return value


def _a(item: Variable) -> str:
    return {float: "a number", int: "an integer", bool: "true or false", str: "a text"}.get(
        item.kind, "bytes in hexadecimal"
    )


def _number(item: Variable, value: Any, units: Units) -> float:
    if isinstance(value, str):
        number, _, unit = value.strip().partition(" ")
        try:
            amount = float(number)
        except ValueError as exc:
            example = f"3 {item.unit}" if item.unit else "3"
            raise WiringError(f"{item.name} is a number, such as {example}, not {value!r}") from exc
        if unit and not item.unit:
            raise WiringError(f"{item.name} has no unit, but {value!r} has one")
        factor, offset = units.conversion(unit.strip(), item.unit)
        return amount * factor + offset
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise WiringError(f"{item.name} is a finite number, not {show(value)}")
    return float(value)
