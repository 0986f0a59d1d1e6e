"""The values of a port as flat columns over time: `position.joint1`, each with its unit."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording import Batch, Port, PortInfo, Recording
from stepbus_schemas import MessageError, parts_of, row_of
from stepbus_tools.signals import Array

ColumnType = Literal[
    "double", "int64", "bool", "string", "binary", "list<double>", "list<int64>", "json"
]
"""A list is of numbers, in a vector whose length changes. json: text of anything nested."""

NUMBERS = ("double", "int64", "bool")
LISTS = ("list<double>", "list<int64>")

Cells = Sequence[Any] | NDArray[Any]
"""The values of one column."""

_TYPES: Mapping[str, ColumnType] = {
    "float": "double",
    "int": "int64",
    "bool": "bool",
    "text": "string",
    "words": "string",
    "bytes": "binary",
}
_LISTED: Mapping[ColumnType, ColumnType] = {"double": "list<double>", "int64": "list<int64>"}
_AXES: Mapping[str, Sequence[str]] = {"3": ("x", "y", "z"), "4": ("x", "y", "z", "w")}


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: its name, type, unit and meaning."""

    name: str
    type: ColumnType
    unit: str = ""
    text: str = ""


CLOCK = (
    Column(name="step", type="int64", text="step of the message"),
    Column(name="t_ns", type="int64", unit="ns", text="simulation time"),
    Column(name="t", type="double", unit="s", text="simulation time"),
)
"""What precedes the columns of every port."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """One field of a message and its columns: several of a vector. is_flat: whether it is one."""

    name: str
    columns: Sequence[Column]
    is_flat: bool = False

    @property
    def is_numeric(self) -> bool:
        """Return whether its values are numbers, one or several."""
        return self.columns[0].type in (*NUMBERS, *LISTS)

    def values(self, batch: Batch, array: NDArray[Any] | None) -> list[Cells]:
        """Return the values of each column, shape (m,); None where a message lacks them.

        array: the field as `Batch.arrays` returns it. An empty vector has none of its values, as
        an absent one. Raises MessageError for any other length than it has columns.
        """
        if array is not None and array.dtype != object:
            if self.is_flat and array.size:
                return list(self._checked(array.reshape(len(array), -1)).T)
            if array.ndim == 1 and not self.is_flat:
                return [array]
        cells = [getattr(message, self.name) for message in batch.messages()]
        if not self.is_flat:
            return [list(map(self._cell, cells))]
        absent = [None] * len(self.columns)
        rows = [absent if not cell else self._row(cell) for cell in cells]
        return [[row[i] for row in rows] for i in range(len(self.columns))]

    def _row(self, value: Any) -> list[Any]:
        row: list[Any] = self._checked(np.array(value, dtype=object).reshape(1, -1))[0].tolist()
        return row

    def _checked(self, table: NDArray[Any]) -> NDArray[Any]:
        if table.shape[1] != len(self.columns):
            count = len(self.columns)
            raise MessageError(f"{self.name} has {table.shape[1]} numbers for {count} names")
        return table

    def _cell(self, value: Any) -> Any:
        match self.columns[0].type:
            case "json" if value is not None:
                return to_json(value)
            case "double" if value is not None:
                return float(value)
        return value

    def labels(self, count: int) -> Sequence[str]:
        """Return what each of its numbers is called beside the others."""
        if self.is_flat:
            return [column.name.partition(".")[2] for column in self.columns]
        return [self.name] if count == 1 else [f"[{index}]" for index in range(count)]


class Table:
    """The columns of one port, and their values piece by piece. name: such as `plant.joint_state`.

    Raises WiringError for a port whose message type is unknown.
    """

    def __init__(self, port: Port) -> None:
        self.port = port
        self.name = dotted(port)
        self.fields = fields_of(port, port.message_class)
        self.columns = [column for field in self.fields for column in field.columns]

    def values(self, batch: Batch, names: Collection[str] | None = None) -> list[Cells]:
        """Return the values of the clock and of each column; raises MessageError.

        names: of the fields; default: all.
        """
        fields = [field for field in self.fields if names is None or field.name in names]
        arrays = batch.arrays(*(field.name for field in fields))
        columns: list[Cells] = [batch.steps, batch.t_ns, batch.t]
        for field in fields:
            columns += field.values(batch, arrays[field.name])
        return columns

    def numbers(
        self, batch: Batch, fields: Sequence[Field]
    ) -> Iterator[tuple[Field, Array | None]]:
        """Yield numeric fields with their numbers, shape (m, n), NaN where a message lacks them.

        None: a vector without names, whose length changes. Raises as `values`.
        """
        arrays = batch.arrays(*(field.name for field in fields))
        for field in fields:
            array = arrays[field.name]
            if field.columns[0].type not in LISTS:
                yield field, np.array(field.values(batch, array), dtype=float).T
            elif array is None or not array.size:
                yield field, None
            else:
                yield field, array.reshape(len(array), -1).astype(float)


def distinct(names: Sequence[str], taken: Collection[str] = ()) -> list[str]:
    """Return names that all differ: one that an earlier or a taken name has ends in `_`."""
    used, made = set(taken), list[str]()
    for name in names:
        new = name
        while new in used or (new != name and new in names):
            new += "_"
        used.add(new)
        made.append(new)
    return made


def to_json(value: Any) -> str:
    """Return a value as JSON; "NaN", "Infinity" and "-Infinity" are strings, as JSON lacks them."""
    plain = _finite(msgspec.to_builtins(value))
    return json.dumps(plain, ensure_ascii=False, separators=(",", ":"))


def _finite(value: Any) -> Any:
    match value:
        case float() if not math.isfinite(value):
            return json.dumps(value)
        case list() | tuple():
            return list(map(_finite, value))
        case dict():
            return {key: _finite(one) for key, one in value.items()}
    return value


def readable(recording: Recording) -> tuple[list[Table], dict[str, str]]:
    """Return what participants have published of known types; and topic → why another is lost."""
    tables, lost = list[Table](), dict[str, str]()
    for port in recording.ports.values():
        if port.topic.startswith("stepbus/"):
            continue
        if port.type not in recording.types:
            lost[port.topic] = f"{port.topic}: unknown message type {port.type!r}"
        elif port.last_step >= 0:
            tables.append(Table(port))
    return tables, lost


def pieces(
    recording: Recording, tables: Sequence[Table], lost: Mapping[str, str]
) -> Iterator[tuple[Table, Batch]]:
    """Yield the messages of all tables piece by piece, but of those that are lost by then."""
    for piece in recording.batches([table.port for table in tables]):
        for table in tables:
            batch = piece[table.port.topic]
            if len(batch.steps) and table.port.topic not in lost:
                yield table, batch


def dotted(port: PortInfo) -> str:
    """Return a port as signals name it: `plant.joint_state`."""
    return f"{port.participant}.{port.name}"


def limits_of(
    limits: Mapping[str, Sequence[float]], quantity: str, index: int
) -> tuple[float, float]:
    """Return the lowest and the highest value of a joint's quantity; infinite without a limit.

    limits: of the port's description. index: of the joint.
    """
    keys = {"position": ("lower", "upper")}.get(quantity, (quantity, quantity))
    low, high = (
        float(limits[key][index]) if index < len(limits.get(key, ())) else default
        for key, default in zip(keys, (-math.inf, math.inf), strict=True)
    )
    return (low, high) if quantity == "position" else (-abs(low), high)


def fields_of(port: PortInfo, message_class: type) -> list[Field]:
    """Return the fields of a port's messages, as its description names and measures them."""
    _, parts = msgspec.json.schema_components([message_class], ref_template="{name}")
    schema = parts[message_class.__name__]
    required = schema.get("required", [])
    return [
        _field(port, name, node, required=name in required)
        for name, node in schema["properties"].items()
    ]


def _field(port: PortInfo, name: str, node: dict[str, Any], *, required: bool) -> Field:
    try:
        scalar, sizes = parts_of(row_of(node, required=required)["type"])
    except (ValueError, KeyError, TypeError):
        # It is nested, which no declaration can say.
        scalar, sizes = "", []
    form, ends = _TYPES.get(scalar, "json"), list[str]()
    if sizes:
        is_fixed = any(map(str.isdecimal, sizes))
        if form in NUMBERS and (form == "double" or not is_fixed):
            ends = _ends(port, sizes, _AXES if "shape" in node else {})
        if not ends:
            form = _LISTED.get(form, "json") if len(sizes) == 1 else "json"
    unit = port.description.units.get(name, node.get("unit", ""))
    units = [unit] * max(1, len(ends))
    if sizes == ["n"] and ends:
        units = [port.description.unit(unit, joint) for joint in range(len(ends))]
    columns = [
        Column(name=name + end, type=form, unit=own, text=node.get("description", ""))
        for end, own in zip(ends or [""], units, strict=True)
    ]
    return Field(name=name, columns=columns, is_flat=bool(ends))


def _ends(port: PortInfo, shape: Sequence[str], axes: Mapping[str, Sequence[str]]) -> list[str]:
    """Return what follows the field in the names of its columns; none of a changing length."""
    labels = (
        port.names
        if size == "n"
        else axes.get(size) or [str(i) for i in range(int(size) if size.isdecimal() else 0)]
        for size in shape
    )
    return ["".join(f".{label}" for label in row) for row in product(*labels)]
