"""What an exported FMU has: a variable for each number, truth value and text of its ports."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from stepbus_orchestrator.recording import Port
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import declared_parameters
from stepbus_participant.parameters.read import default_of, fields_of, kind_of, options_of
from stepbus_schemas import Decoder, Description, RunError, WiringError, due_step
from stepbus_schemas.schema import field_docstrings

PARAMS = "params"
_KINDS = {float: "Real", int: "Integer", bool: "Boolean", str: "String"}


class Row(msgspec.Struct, frozen=True):
    """A field of a port, a parameter, or the time, and its variables: name, description.

    owner: a participant. port: `params` of a parameter. kind: `Real`, `Integer`, `Boolean` or
    `String`. shape: () of a scalar. start: a value for each variable.
    """

    causality: Literal["input", "output", "parameter", "independent"]
    owner: str
    port: str
    field: str
    kind: str
    variables: Sequence[tuple[str, str]]
    start: Sequence[Any]
    shape: Sequence[int] = ()
    unit: str = ""

    def flat(self, value: Any) -> list[Any]:
        """Return a value as one for each variable; raises RunError for another shape."""
        array = np.array(value, dtype=object)
        if value is None or array.shape != tuple(self.shape):
            text = f"{self.owner}.{self.port}.{self.field} is absent, or has shape {array.shape}"
            raise RunError(f"{text} now, not {tuple(self.shape)}")
        entries: list[Any] = array.ravel().tolist()
        return entries


class Played(msgspec.Struct, frozen=True):
    """A port that the importer plays: messages of a type; what its source says of it.

    every: of the source. delay: of who reads it, which works at each `reads`-th step.
    """

    type: str
    description: Description
    every: int
    delay: int
    reads: int

    def is_due(self, index: int) -> bool:
        """Return whether a message is new at a step, as it would be in a run."""
        due, before = (due_step(i, self.delay, self.every) for i in (index, index - self.reads))
        return index % self.reads == 0 <= due != before


class Interface(msgspec.Struct, frozen=True, kw_only=True):
    """An FMU, as its resources hold it: the scenario is a path there.

    importer: the participant in whose place its importer is. played: its outputs.
    """

    scenario: str
    text: str
    step_ns: int
    duration_s: float | None
    importer: str
    played: Mapping[str, Played]
    rows: Sequence[Row]


def _variables(
    parts: Sequence[str], text: str, shape: Sequence[int] = (), labels: Sequence[str] = ()
) -> Iterator[tuple[str, str]]:
    """Yield name and description of each variable; indices are from 1 on, as FMI has them."""
    stem = ".".join(part if part.isidentifier() else f"'{part}'" for part in filter(None, parts))
    for index in product(*map(range, shape)):
        end = f"[{','.join(str(i + 1) for i in index)}]" if index else ""
        label = f", {labels[index[0]]}" if index and labels else ""
        yield stem + end, text + label


def port_rows(source: Port, prefix: str, lost: list[str], own: Any) -> Iterator[Row]:
    """Yield a row for each field of a port's first message; say in `lost` why others have none.

    prefix: of the names. own: causality, participant, port. Raises WiringError for a lost input
    that is required.
    """
    (side, owner, port), cls = own, source.message_class
    message = next((Decoder(cls)(entry.data) for entry in source.entries()), None)
    schema = msgspec.json.schema_components([cls], ref_template="{name}")[1][cls.__name__]
    for name, node in schema["properties"].items():
        array = np.array(getattr(message, name, None), dtype=object)
        if why := _why_not(node, array):
            lost.append(f"{owner}.{port}.{name}: {why}")
            if name in schema.get("required", ()) and side == "input":
                raise WiringError(f"{lost[-1]}; {source.type} requires it, so it is no FMU")
            continue
        labels = source.names if "n" in node.get("shape", ())[:1] else ()
        parts, text = (prefix, port, name), node.get("description", "")
        names = list(_variables(parts, text, array.shape, labels))
        kind, start = _KINDS[type(array.flat[0])], array.ravel().tolist()
        unit = source.units.get(name, node.get("unit", "")) if kind == "Real" else ""
        yield Row(side, owner, port, name, kind, names, start, array.shape, unit)


def _why_not(node: Any, array: Any) -> str:
    """Return why a field has no variables; empty where it has."""
    if array.shape and not all(s == "n" or s.isdecimal() for s in node.get("shape", ["k"])):
        return "a list of any length"
    if not array.size or array.flat[0] is None:
        return "absent in the first message"
    kind = type(array.flat[0])
    return "" if kind in _KINDS else f"FMI has no variable for {kind.__name__}"


def parameter_rows(spec: ParticipantSpec, folder: Path, prefix: str) -> Iterator[Row]:
    """Yield the rows of those parameters that a class declares as numbers or truth values."""
    declared: Any = declared_parameters(spec.participant.rpartition(":")[0], folder)
    if declared is None:
        return
    key, kinds = declared.kinds
    declared = kinds.get(spec.params.get(key, ""), declared)
    texts = field_docstrings(declared)
    for name, field in fields_of(declared).items():
        value = spec.params.get(name, default_of(field))
        value = getattr(value, "value", value)
        if not isinstance(value, bool | int | float) or field.name.endswith("_ns"):
            continue
        types = set(map(kind_of, options_of(field.type)))
        kind = "Boolean" if bool in types else "Integer" if int in types - {float} else "Real"
        text = " ".join(texts.get(field.name, "").split())
        unit = re.search(r"\[([^\]]+)\]", text) if kind == "Real" else None
        names = list(_variables((prefix, PARAMS, name), text))
        start = [float(value) if kind == "Real" else value]
        own = (spec.name, PARAMS, name, kind, names, start)
        yield Row("parameter", *own, unit=unit[1] if unit else "")
