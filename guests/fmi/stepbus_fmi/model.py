"""What a model description says: the variables of an FMU, their units, what it can do."""

import io
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree as ET

from stepbus_participant import need, suggest
from stepbus_schemas import WiringError, error_text

KINDS: Mapping[str, type] = {
    **dict.fromkeys(("Real", "Float32", "Float64"), float),
    **dict.fromkeys(("Integer", "Enumeration"), int),
    **{f"{sign}Int{bits}": int for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "Boolean": bool,
    "String": str,
    "Binary": bytes,
}
"""Type of FMI 2 or 3 → what its values are in Python."""


@dataclass(frozen=True)
class Variable:
    """A variable. shape: of an array, with the sizes that the start values give it; else empty.

    type_name: as the standard has it. items: of an enumeration, name → number.
    """

    name: str
    reference: int
    type_name: str
    causality: str
    variability: str
    initial: str
    start: str | None
    unit: str
    description: str
    shape: tuple[int, ...] = ()
    items: tuple[tuple[str, int], ...] = ()
    media: str = ""

    @property
    def kind(self) -> type:
        """Return what its values are in Python."""
        return KINDS[self.type_name]

    @property
    def size(self) -> int:
        """Return how many values it has."""
        return prod(self.shape)

    @property
    def names(self) -> list[str]:
        """Return the names of its values: `x`, or `x[1]`, `x[2]`, in row-major order."""
        if not self.shape:
            return [self.name]
        places = product(*(range(1, size + 1) for size in self.shape))
        return [f"{self.name}[{','.join(map(str, place))}]" for place in places]


@dataclass(frozen=True)
class Model:
    """The model description of an FMU for co-simulation. description: FMPy's."""

    file: str
    description: Any
    variables: Mapping[str, Variable]

    @property
    def major(self) -> int:
        """Return 2 or 3, the major version of FMI."""
        return int(self.description.fmiVersion[0])

    @property
    def can(self) -> Any:
        """Return the flags of its co-simulation interface, as FMPy names them."""
        return self.description.coSimulation

    @property
    def saves(self) -> bool:
        """Return whether it claims that its state can be saved and restored."""
        return bool(self.can.canGetAndSetFMUstate and self.can.canSerializeFMUstate)

    @property
    def internal_step(self) -> float:
        """Return the step of its own solver [s]; 0: it states none."""
        try:
            return float(self.can.fixedInternalStepSize or 0)
        except ValueError as exc:
            text = f"{self.file}: fixedInternalStepSize is {self.can.fixedInternalStepSize!r}"
            raise WiringError(f"{text}, no number") from exc

    @cached_property
    def places(self) -> Mapping[str, tuple[Variable, int]]:
        """Return name of each value → its variable, and where in that it is."""
        return {
            name: (item, index)
            for item in self.variables.values()
            for index, name in enumerate(item.names)
        }

    def find(self, name: str) -> Variable:
        """Return a variable; raises WiringError where there is none."""
        if name not in self.variables:
            raise WiringError(
                f"{self.file} has no variable {name!r}{suggest(name, self.variables)}"
            )
        return self.variables[name]

    def of(self, causality: str, kind: type | None = None) -> list[Variable]:
        """Return the variables of a causality, and of a kind, in the order of the file."""
        return [
            item
            for item in self.variables.values()
            if item.causality == causality and kind in (None, item.kind)
        ]


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
    try:
        description = fmpy.read_model_description(open_fmu(path, inside), validate=False)
    except WiringError:
        raise
    except Exception as exc:  # FMPy raises what its parsers raise
        why = _broken_rule(fmpy, open_fmu(path, inside)) or error_text(exc)
        raise WiringError(f"{name} is no FMU: {why}") from exc
    if description.fmiVersion[:1] not in ("2", "3"):
        raise WiringError(
            f"{name} is for FMI {description.fmiVersion}; stepbus takes FMI 2.0 and 3.0: export it "
            "again with a newer version of its tool"
        )
    if description.coSimulation is None:
        has = "model exchange" if description.modelExchange else "scheduled execution"
        raise WiringError(
            f"{name} has no co-simulation interface, only {has}; export it for co-simulation, "
            "which brings its own solver"
        )
    clocks = [item.name for item in description.modelVariables if item.type == "Clock"]
    if clocks:
        raise WiringError(f"{name} has clocks ({', '.join(clocks[:5])}), which are not supported")
    is_binary = any(item.type == "Binary" for item in description.modelVariables)
    media = _media(open_fmu(path, inside)) if is_binary else {}
    return Model(name, description, _variables(description, named(start or {}), name, media))


def named(start: Mapping[str, Any], within: str = "") -> dict[str, Any]:
    """Return variable → start value: `{motor: {k: 2}}`, as `--set` writes it, is `motor.k`."""
    found: dict[str, Any] = {}
    for name, value in start.items():
        is_part = isinstance(value, Mapping)
        found |= named(value, f"{within}{name}.") if is_part else {f"{within}{name}": value}
    return found


def _broken_rule(fmpy: Any, file: Path | IO[bytes]) -> str:
    """Return what the schema finds wrong first in a model description that FMPy cannot read."""
    try:
        fmpy.read_model_description(file, validate=True)
    except fmpy.model_description.ValidationError as exc:
        return str(exc.problems[0])
    except Exception:  # noqa: BLE001  nothing that a schema describes
        return ""
    return ""


def _media(file: Path | IO[bytes]) -> dict[str, str]:
    """Return the media types of binary variables by name, which FMPy does not read."""
    with zipfile.ZipFile(file) as archive, archive.open("modelDescription.xml") as stream:
        rows = ET.parse(stream).iter("Binary")  # noqa: S314  FMPy has read it
        return {row.get("name", ""): row.get("mimeType", "") for row in rows}


def _variables(
    description: Any, start: Mapping[str, Any], name: str, media: Mapping[str, str]
) -> dict[str, Variable]:
    found = {}
    for item in description.modelVariables:
        if item.type not in KINDS:
            raise WiringError(f"{name}: variable {item.name} has the unsupported type {item.type}")
        found[item.name] = _variable(
            item, tuple(_shape(item, start, name)), media.get(item.name, "")
        )
    return found


def _variable(item: Any, shape: tuple[int, ...], media: str) -> Variable:
    declared = item.declaredType
    return Variable(
        name=item.name,
        reference=item.valueReference,
        type_name=item.type,
        causality=item.causality,
        variability=item.variability,
        initial=item.initial or "",
        start=item.start,
        unit=item.unit or (declared.unit if declared is not None else "") or "",
        description=item.description or "",
        shape=shape,
        items=_items(declared) if declared is not None and item.type == "Enumeration" else (),
        media=media,
    )


def _items(declared: Any) -> tuple[tuple[str, int], ...]:
    return tuple((item.name, int(item.value)) for item in declared.items)


def _shape(item: Any, start: Mapping[str, Any], name: str) -> Iterator[int]:
    """Yield the sizes of an array, some of which a structural parameter may set."""
    for dimension in item.dimensions:
        by = dimension.variable
        size = dimension.start if by is None else start.get(by.name, by.start)
        if not str(size).isdigit():
            raise WiringError(f"{name}: the size of {item.name} is {size!r}, no whole number")
        yield int(size)


def capabilities(model: Model) -> list[str]:
    """Return what an FMU can do, and what it cannot, in words."""
    can = model.can
    flags: Sequence[tuple[Any, str]] = (
        (can.hasEventMode, "has an event mode"),
        (can.mightReturnEarlyFromDoStep, "may return early from a step"),
        (can.canInterpolateInputs, "can interpolate inputs"),
        (can.canHandleVariableCommunicationStepSize, "takes steps of any size"),
        (model.saves, "can save its state"),
        (can.needsExecutionTool, "needs the tool that exported it"),
    )
    fixed = can.fixedInternalStepSize
    return [
        *(text for flag, text in flags if flag),
        *([f"internal step {fixed} s"] if fixed else []),
    ]
