"""The flat columns of a port: `position.joint1`, each with its unit."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording import Batch, Port
from stepbus_schemas import Types, json_schema

ColumnType = Literal["double", "int64", "bool", "string", "binary", "list", "json"]
"""list: of numbers, in a vector whose length changes. json: text of anything nested."""

Cells = Sequence[Any] | NDArray[Any]
"""The values of one column."""

_SCALARS: Mapping[str, ColumnType] = {
    "number": "double",
    "integer": "int64",
    "boolean": "bool",
    "string": "string",
}
_AXES = {3: ("x", "y", "z"), 4: ("x", "y", "z", "w")}
_to_json = msgspec.json.Encoder().encode


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
"""The first columns of every port."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """One field of a message and its columns: several of a vector. is_flat: whether it is one."""

    name: str
    columns: Sequence[Column]
    is_flat: bool = False

    def values(self, batch: Batch, array: NDArray[Any] | None) -> list[Cells]:
        """Return the values of each column, shape (m,); None where a message lacks them.

        array: the field as `Batch.arrays` returns it. An empty vector has none of its values, as
        an absent one. Raises ValueError for any other length than it has columns.
        """
        count = len(self.columns)
        if self.is_flat:
            if array is not None and array.dtype != object:
                if not array.size:
                    return [[None] * len(array)] * count
                table = array.reshape(len(array), -1)
                _check_width(self, table.shape[1])
                return list(table.T)
            rows = [self._row(getattr(m, self.name)) for m in batch.messages()]
            return [[row[i] for row in rows] for i in range(count)]
        if array is not None and array.ndim == 1 and array.dtype != object:
            return [array]
        return [list(map(self._cell, (getattr(m, self.name) for m in batch.messages())))]

    def _row(self, value: Any) -> Sequence[Any]:
        if value is None:
            return [None] * len(self.columns)
        row = np.asarray(value, dtype=float).ravel().tolist()
        if not row:
            return [None] * len(self.columns)
        _check_width(self, len(row))
        return row

    def _cell(self, value: Any) -> Any:
        if value is None:
            return None
        match self.columns[0].type:
            case "json":
                return _to_json(value).decode()
            case "double":
                return float(value)
        return value


def _check_width(field: Field, width: int) -> None:
    if width != len(field.columns):
        raise ValueError(f"{field.name} has {width} numbers for {len(field.columns)} names")


class Table:
    """The columns of one port, and their values piece by piece.

    Raises WiringError for a port whose message type is unknown.
    """

    def __init__(self, port: Port, types: Types) -> None:
        self.port = port
        self.fields = list(_fields(port, types))
        self.columns = [*CLOCK, *(column for field in self.fields for column in field.columns)]
        port.message_class  # noqa: B018  (raises for an unknown type)

    def values(self, batch: Batch, names: Collection[str] | None = None) -> list[Cells]:
        """Return the values of each column; raises MessageError or ValueError.

        names: of the fields; default: all.
        """
        fields = [field for field in self.fields if names is None or field.name in names]
        arrays = batch.arrays(*(field.name for field in fields))
        t_ns = np.rint(batch.t * 1e9).astype(np.int64)
        columns: list[Cells] = [batch.steps, t_ns, batch.t]
        for field in fields:
            columns += field.values(batch, arrays[field.name])
        return columns


def _fields(port: Port, types: Types) -> Iterator[Field]:
    schema = json_schema(port.type, types)
    definitions = schema.get("$defs", {})
    for name, node in schema["properties"].items():
        yield _field(port, name, node, definitions)


def _field(port: Port, name: str, node: Mapping[str, Any], definitions: Mapping[str, Any]) -> Field:
    unit, text = port.units.get(name, node.get("unit", "")), node.get("description", "")

    def column(end: str, form: ColumnType) -> Column:
        return Column(name=name + end, type=form, unit=unit, text=text)

    real = _resolved(node, definitions)
    form = _scalar(real)
    if form:
        return Field(name=name, columns=[column("", form)])
    if real.get("type") != "array":
        return Field(name=name, columns=[column("", "json")])
    ends, is_numeric = _ends(port, node.get("shape", []), real), _is_numeric(real, definitions)
    if ends and is_numeric:
        return Field(name=name, columns=[column(end, "double") for end in ends], is_flat=True)
    is_list = _scalar(_item(real, definitions)) in ("double", "int64")
    return Field(name=name, columns=[column("", "list" if is_list else "json")])


def _resolved(node: Mapping[str, Any], definitions: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a schema without `null` and references."""
    options = [one for one in node.get("anyOf", [node]) if one.get("type") != "null"]
    row = options[0] if len(options) == 1 else {}
    reference = row.get("$ref", "").rpartition("/")[2]
    return definitions.get(reference, row) if reference else row


def _scalar(node: Mapping[str, Any]) -> ColumnType | None:
    if "contentEncoding" in node:
        return "binary"
    if "enum" in node and "type" not in node:
        return "string" if all(isinstance(one, str) for one in node["enum"]) else None
    return _SCALARS.get(node.get("type", ""))


def _item(node: Mapping[str, Any], definitions: Mapping[str, Any]) -> Mapping[str, Any]:
    items = node.get("prefixItems", [{}])[0] if "prefixItems" in node else node.get("items")
    return _resolved(items, definitions) if isinstance(items, dict) else {}


def _is_numeric(node: Mapping[str, Any], definitions: Mapping[str, Any]) -> bool:
    while node.get("type") == "array":
        if not all(one.get("type") == "number" for one in node.get("prefixItems", ())):
            return False
        node = _item(node, definitions)
    return node.get("type") in ("number", "integer", "boolean")


def _ends(port: Port, shape: Sequence[str], node: Mapping[str, Any]) -> list[str]:
    """Return what follows the field in the names of its columns; none of a changing length."""
    fixed = len(node.get("prefixItems", ()))
    if not shape:
        return [f".{index}" for index in range(fixed)]
    parts: list[Sequence[str]] = []
    for size in shape:
        labels = port.names if size == "n" else _labels(size)
        if not labels:
            return []
        parts.append(labels)
    ends = [""]
    for labels in parts:
        ends = [f"{end}.{label}" for end in ends for label in labels]
    return ends


def _labels(size: str) -> Sequence[str]:
    if not size.isdecimal():
        return []
    return _AXES.get(int(size)) or [str(index) for index in range(int(size))]
