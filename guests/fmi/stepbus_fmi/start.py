"""Start values as a scenario writes them."""

from collections.abc import Mapping
from functools import partial
from math import isfinite, prod
from typing import Any

from stepbus_participant import Problems
from stepbus_participant.parameters import show
from stepbus_schemas import WiringError, suggest

from .model import Model, Variable, kind_of, named
from .units import Units

_KINDS = {float: "a finite number", int: "an integer", bool: "true or false", str: "a text"}


def start_values(model: Model, given: Mapping[str, Any], problems: Problems) -> dict[str, Any]:
    """Return variable → list of values, as the FMU takes them; adds what is wrong."""
    found = {}
    for name, value in named(given).items():
        read = problems.attempt(("start", name), partial(_read, model, name, value))
        if read is not None:
            found[name] = read
    return found


def _read(model: Model, name: str, value: Any) -> list[Any]:
    item = model.find(name)
    if item.causality != "input" and item.initial not in ("exact", "approx"):
        what = f"{item.variability} {item.causality}"
        raise WiringError(f"{name} is a {what} variable that the FMU computes; it cannot be set")
    values = _flat(value) if item.shape else [value]
    if len(values) != prod(item.shape):
        shape = " × ".join(map(str, item.shape))
        raise WiringError(f"{name} has {prod(item.shape)} values ({shape}), not {len(values)}")
    return [read_value(item, one, model.units) for one in values]


def _flat(value: Any) -> list[Any]:
    if not isinstance(value, list | tuple):
        return [value]
    return [one for part in value for one in _flat(part)]


def read_value(item: Variable, value: Any, units: Units) -> Any:
    """Return one value of a variable; raises WiringError for one that it cannot have."""
    kind = kind_of(item)
    if isinstance(value, str) and kind is float:
        return _number(item, value, units)
    if isinstance(value, str) and kind is int:
        items = {one.name: int(one.value) for one in getattr(item.declaredType, "items", ())}
        if value in items:
            return items[value]
        raise WiringError(f"{item.name} has no item {value!r}{suggest(value, items)}")
    if isinstance(value, str) and kind is bytes:
        try:
            return bytes.fromhex(value)
        except ValueError as exc:
            raise WiringError(f"{item.name} takes bytes in hexadecimal, not {value!r}") from exc
    if type(value) is int and kind is float:
        return float(value)
    if type(value) is not kind or (isinstance(value, float) and not isfinite(value)):
        wanted = _KINDS.get(kind, "bytes in hexadecimal")
        raise WiringError(f"{item.name} is {wanted}, not {show(value)}")
    return value


def _number(item: Variable, text: str, units: Units) -> float:
    number, _, unit = text.strip().partition(" ")
    try:
        amount = float(number)
    except ValueError as exc:
        example = f"3 {item.unit}" if item.unit else "3"
        raise WiringError(f"{item.name} is a number, such as {example}, not {text!r}") from exc
    if unit and not item.unit:
        raise WiringError(f"{item.name} has no unit, but {text!r} has one")
    factor, offset = units.conversion(unit.strip(), item.unit)
    return amount * factor + offset
