"""What an exported FMU has: a variable for each number, truth value and text of its ports."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from stepbus_orchestrator.recording import Port
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import Problems, SettingsError, declared_parameters
from stepbus_participant.parameters.read import default_of, fields_of, read
from stepbus_schemas import Decoder, Description, RunError, WiringError, parts_of, row_of
from stepbus_schemas.schema import field_docstrings

PARAMS = "params"
_NEUTRAL: Mapping[str, tuple[str, Any]] = {
    "float": ("Real", 0.0),
    "int": ("Integer", 0),
    "bool": ("Boolean", False),
    "text": ("String", ""),
    "words": ("String", ""),
}
"""Scalar of a message type → its type in FMI 2, and its start value."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """A field of a port, or a parameter, and its variables.

    owner: a participant; prefix: what stands before the port in their names. port: `params` of a
    parameter. kind: `Real`, `Integer`, `Boolean` or `String`. shape: () of a scalar. labels: of
    the entries of the first dimension. start: a value for each variable.
    """

    causality: Literal["input", "output", "parameter"]
    owner: str
    prefix: Sequence[str]
    port: str
    field: str
    kind: str
    shape: Sequence[int] = ()
    labels: Sequence[str] = ()
    unit: str = ""
    text: str = ""
    start: Sequence[Any]

    def variables(self) -> Iterator[tuple[str, str]]:
        """Yield name and description of each variable; indices are from 1 on, as FMI has them."""
        parts = (*self.prefix, self.port, self.field)
        stem = ".".join(part if part.isidentifier() else f"'{part}'" for part in parts)
        for index in product(*map(range, self.shape)):
            end = f"[{','.join(str(i + 1) for i in index)}]" if index else ""
            label = f", {self.labels[index[0]]}" if index and self.labels else ""
            yield stem + end, self.text + label

    def flat(self, value: Any) -> list[Any]:
        """Return a value as one for each variable; raises RunError for another shape."""
        array = np.array(value, dtype=object)
        if value is None or array.shape != tuple(self.shape):
            now = "is absent" if value is None else f"has shape {array.shape}"
            where = f"{self.owner}.{self.port}.{self.field}"
            raise RunError(f"{where} {now}; the FMU has variables for shape {tuple(self.shape)}")
        entries: list[Any] = array.ravel().tolist()
        return entries

    def nested(self, values: Sequence[Any]) -> Any:
        """Return the values of the variables as one of the field."""
        return np.array(values, dtype=object).reshape(self.shape).tolist()


class Interface(msgspec.Struct, frozen=True, kw_only=True):
    """An FMU, as its resources hold it.

    scenario: path of the scenario there. text: its description. participant: the one that it is;
    empty: all. played: the one that the importer plays. has_state: whether it can be saved.
    described: the inputs of `participant`, or the outputs of `played`.
    """

    scenario: str
    text: str
    step_ns: int
    duration_s: float | None
    participant: str = ""
    played: str = ""
    has_state: bool = False
    described: Mapping[str, Description]
    rows: Sequence[Row]


def port_rows(source: Port, lost: list[str], **given: Any) -> list[Row]:
    """Return the rows of a recorded port; add a text to `lost` for each field that has none.

    An optional field that is absent in the first message has none. given: `causality`, `owner`,
    `prefix`, `port`. Raises WiringError for an input that the variables do not suffice for.
    """
    rows, first = list[Row](), next(iter(source.entries()), None)
    message = None if first is None else Decoder(source.message_class)(first.data)
    _, parts = msgspec.json.schema_components([source.message_class], ref_template="{name}")
    schema = parts[source.message_class.__name__]
    for name, node in schema["properties"].items():
        is_required = name in schema.get("required", ())
        try:
            rows.append(_row(source, name, node, message, is_required=is_required, **given))
        except ValueError as exc:
            lost.append(f"{given['owner']}.{given['port']}.{name}: {exc}")
            if is_required and given["causality"] == "input":
                raise WiringError(
                    f"{lost[-1]}; {source.type} requires it, so it is no FMU"
                ) from exc
    return rows


def _row(
    source: Port, name: str, node: Any, message: Any, *, is_required: bool, **given: Any
) -> Row:
    """Return the row of a field; raises ValueError with the reason why it has none."""
    try:
        form = row_of(node, required=is_required)["type"]
        scalar, sizes = parts_of(form)
    except (ValueError, KeyError, TypeError):
        scalar, sizes = "nested", []
    if scalar not in _NEUTRAL:
        raise ValueError(f"FMI has no variable for {scalar}")
    if not all(size == "n" or size.isdecimal() for size in sizes):
        raise ValueError("a list of any length")
    shape = [len(source.names) if size == "n" else int(size) for size in sizes]
    if 0 in shape:
        raise ValueError("a vector without names")
    value = getattr(message, name, None)
    if not is_required and (value is None or (shape and not value)):
        raise ValueError("absent in the first message")
    kind, neutral = _NEUTRAL[scalar]
    row = Row(
        field=name,
        kind=kind,
        shape=shape,
        labels=source.names if sizes[:1] == ["n"] else (),
        unit=source.units.get(name, node.get("unit", "")) if kind == "Real" else "",
        text=node.get("description", ""),
        start=[form[0] if scalar == "words" else neutral] * math.prod(shape),
        **given,
    )
    if value is None:
        return row
    # XML Schema has no word of Python's for what is not finite.
    start = [neutral if kind == "Real" and not math.isfinite(v) else v for v in row.flat(value)]
    return msgspec.structs.replace(row, start=start)


def parameter_rows(spec: ParticipantSpec, folder: Path, prefix: Sequence[str]) -> list[Row]:
    """Return the rows of a participant's parameters that are numbers or truth values.

    They are those that its class declares: their type, and their unit in the docstring.
    """
    source = spec.participant.rpartition(":")[0]
    declared: Any = declared_parameters(source, folder) if source else None
    if declared is None:
        return []
    key, kinds = declared.kinds
    declared = kinds.get(spec.params.get(key, ""), declared)
    texts, rows = field_docstrings(declared), list[Row]()
    for name, field in fields_of(declared).items():
        value = spec.params.get(name, default_of(field))
        value = getattr(value, "value", value)
        if not isinstance(value, bool | int | float) or field.name.endswith("_ns"):
            continue
        kind = "Boolean" if isinstance(value, bool) else "Integer"
        if kind == "Integer" and any(_fits(field.type, value + part) for part in (0.25, -0.25)):
            kind, value = "Real", float(value)
        text = " ".join(texts.get(field.name, "").split())
        unit = re.search(r"\[([^\]]+)\]", text)
        rows.append(
            Row(
                causality="parameter",
                owner=spec.name,
                prefix=prefix,
                port=PARAMS,
                field=name,
                kind=kind,
                unit=unit[1] if unit and kind == "Real" else "",
                text=text,
                start=[value],
            )
        )
    return rows


def _fits(wanted: Any, value: float) -> bool:
    problems = Problems()
    read(wanted, value, problems)
    try:
        problems.refuse()
    except SettingsError:
        return False
    return True
