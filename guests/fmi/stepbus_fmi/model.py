"""What a model description says, and the start values that a scenario gives its variables."""

import io
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from math import isfinite, prod
from pathlib import Path
from typing import IO, Any

from stepbus_participant import Problems, need, suggest
from stepbus_participant.parameters import show
from stepbus_schemas import WiringError, error_text

from .units import Units

KINDS: Mapping[str, type] = {
    **dict.fromkeys(("Real", "Float32", "Float64"), float),
    **dict.fromkeys(("Integer", "Enumeration"), int),
    **{f"{sign}Int{bits}": int for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "Boolean": bool,
    "String": str,
    "Binary": bytes,
}
"""Type of FMI 2 or 3 → what its values are in Python."""
_SAID = {float: "a finite number", int: "an integer", bool: "true or false", str: "a text"}
Variable = Any
"""FMPy's `ModelVariable`; its unit may be its type's, its shape be set by start values."""


def kind_of(item: Variable) -> type:
    """Return what the values of a variable are in Python."""
    return KINDS[item.type]


def names_of(item: Variable) -> list[str]:
    """Return the names of a variable's values: `x`, or `x[1]`, `x[2]`, in row-major order."""
    if not item.shape:
        return [item.name]
    places = product(*(range(1, size + 1) for size in item.shape))
    return [f"{item.name}[{','.join(map(str, place))}]" for place in places]


@dataclass(frozen=True)
class Model:
    """The model description of an FMU for co-simulation. description: FMPy's.

    internal_step: of its own solver [s]; 0: it states none.
    """

    file: str
    description: Any
    variables: Mapping[str, Variable]
    units: Units
    internal_step: float

    @cached_property
    def is_3(self) -> bool:
        """Return whether it is for FMI 3, not 2."""
        return bool(self.description.fmiMajorVersion == 3)

    @property
    def can(self) -> Any:
        """Return the flags of its co-simulation interface, as FMPy names them."""
        return self.description.coSimulation

    @cached_property
    def places(self) -> Mapping[str, Variable]:
        """Return name of each value → its variable."""
        return {name: item for item in self.variables.values() for name in names_of(item)}

    def find(self, name: str) -> Variable:
        """Return a variable; raises WiringError where there is none."""
        if name not in self.variables:
            near = suggest(name, self.variables)
            raise WiringError(f"{self.file} has no variable {name!r}{near}")
        return self.variables[name]

    def of(self, causality: str, kind: type | None = None) -> list[Variable]:
        """Return the variables of a causality, and of a kind, in the order of the file."""
        found = [item for item in self.variables.values() if item.causality == causality]
        return [item for item in found if kind in (None, kind_of(item))]


def open_fmu(path: Path, inside: str = "") -> Path | IO[bytes]:
    """Return an FMU, or the one inside an archive; raises WiringError where there is none."""
    if not inside:
        return path
    try:
        with zipfile.ZipFile(path) as archive:
            return io.BytesIO(archive.read(inside.removeprefix("/")))
    except (OSError, zipfile.BadZipFile, KeyError) as exc:
        raise WiringError(f"{path.name} has no {inside!r}: {error_text(exc)}") from exc


def read_model(path: Path, inside: str = "", start: Mapping[str, Any] | None = None) -> Model:
    """Read the model description of an FMU for co-simulation.

    start: start values; structural parameters among them set the sizes of arrays.
    Raises WiringError where it cannot be read, or the FMU cannot take part.
    """
    (fmpy,) = need("an FMU", "fmpy")
    if path.suffix.lower() not in (".fmu", ".ssp"):
        # Recordings tell by their names which files are programs.
        raise WiringError(f"the name of an FMU ends with .fmu, not {path.name!r}")
    name = f"{path.name}/{inside.removeprefix('/')}" if inside else path.name
    file = open_fmu(path, inside)
    try:
        try:
            said = fmpy.read_model_description(file, validate=False)
        except Exception:  # noqa: BLE001  FMPy raises what its parsers raise
            # What the schema finds first says more than where the reader stumbles.
            said = fmpy.read_model_description(file, validate=True)
    except Exception as exc:
        why = getattr(exc, "problems", None) or [error_text(exc)]
        raise WiringError(f"{name} is no FMU: {why[0]}") from exc
    if said.fmiVersion[:1] not in ("2", "3"):
        raise WiringError(
            f"{name} is for FMI {said.fmiVersion}; stepbus takes FMI 2.0 and 3.0: export it again "
            "with a newer version of its tool"
        )
    if said.coSimulation is None:
        has = "model exchange" if said.modelExchange else "scheduled execution"
        raise WiringError(
            f"{name} has no co-simulation interface, only {has}; export it for co-simulation, "
            "which brings its own solver"
        )
    clocks = [item.name for item in said.modelVariables if item.type == "Clock"]
    if clocks:
        raise WiringError(f"{name} has clocks ({', '.join(clocks[:5])}), which are not supported")
    start = named(start or {})
    for item in said.modelVariables:
        item.unit = item.unit or getattr(item.declaredType, "unit", None) or ""
        item.shape = tuple(_shape(item, start, name))
    return Model(
        file=name,
        description=said,
        variables={item.name: item for item in said.modelVariables},
        units=Units(said.unitDefinitions, name),
        internal_step=number(
            f"{name}: fixedInternalStepSize", said.coSimulation.fixedInternalStepSize
        ),
    )


def named(start: Mapping[str, Any], within: str = "") -> dict[str, Any]:
    """Return variable → start value: `{motor: {k: 2}}`, as `--set` writes it, is `motor.k`."""
    found: dict[str, Any] = {}
    for name, value in start.items():
        is_part = isinstance(value, Mapping)
        found |= named(value, f"{within}{name}.") if is_part else {f"{within}{name}": value}
    return found


def number(what: str, text: Any) -> float:
    """Return the number that a file says, 0 where it says none; raises WiringError."""
    try:
        return float(text or 0)
    except ValueError as exc:
        raise WiringError(f"{what} is {text!r}, which is no number") from exc


def _shape(item: Any, start: Mapping[str, Any], name: str) -> Iterator[int]:
    """Yield the sizes of an array, some of which a structural parameter may set."""
    for dimension in item.dimensions:
        by = dimension.variable
        size = dimension.start if by is None else start.get(by.name, by.start)
        if not str(size).isdigit():
            raise WiringError(f"{name}: the size of {item.name} is {size!r}, no whole number")
        yield int(size)


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
        wanted = _SAID.get(kind, "bytes in hexadecimal")
        raise WiringError(f"{item.name} is {wanted}, not {show(value)}")
    return value


def _number(item: Variable, text: str, units: Units) -> float:
    first, _, unit = text.strip().partition(" ")
    try:
        amount = float(first)
    except ValueError as exc:
        example = f"3 {item.unit}" if item.unit else "3"
        raise WiringError(f"{item.name} is a number, such as {example}, not {text!r}") from exc
    if unit and not item.unit:
        raise WiringError(f"{item.name} has no unit, but {text!r} has one")
    factor, offset = units.conversion(unit.strip(), item.unit)
    return amount * factor + offset
