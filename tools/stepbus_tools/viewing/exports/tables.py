"""Tables of a recording: Parquet and CSV, one file for each port or all ports in one file."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Batch, Recording
from stepbus_participant import need
from stepbus_schemas import StepbusError
from stepbus_tools.viewing.exports.export_files import (
    Exported,
    Reached,
    nothing_to_export,
    unreadable,
)
from stepbus_tools.whole_file import replaced

from .columns import CLOCK, Cells, Column, Table

_GROUP_ROWS = 100_000
_GROUP_BYTES = 16 * 1024 * 1024
"""Of a row group, whichever comes first."""
_OWN = "stepbus/"
_COLUMNS_FILE = "columns.csv"
LONG = (
    Column(name="step", type="int64", text="step of the message"),
    Column(name="t", type="double", unit="s", text="simulation time"),
    Column(name="signal", type="string", text="participant.port.column"),
    Column(name="unit", type="string", text="unit of the value"),
    Column(name="value", type="double", text="value, where it is a number"),
    Column(name="text", type="string", text="value, where it is none"),
)
"""The columns of a file with all ports: a row for each value."""


class Sink(Protocol):
    """A table that is written piece by piece."""

    def __enter__(self) -> Self: ...
    def __exit__(self, error: type[BaseException] | None, *_: object) -> None: ...
    def write(self, values: Sequence[Cells]) -> None:
        """Write rows. values: of each column."""


def export_tables(recording: Recording, target: Path, form: str, reached: Reached) -> Exported:
    """Write the messages of all ports as `parquet` or `csv`.

    target: a folder, which gets one file for each port, `plant.joint_state.parquet`; or a file
    that ends in .parquet or .csv, which gets a row for each value.

    Raises RecordingFailed when nothing can be exported or a file cannot be written, ExtraMissing
    without the library.
    """
    if form == "parquet":
        need("the export to Parquet", "pyarrow", "pyarrow.parquet")
    tables, problems = _tables(recording)
    is_file = target.suffix == f".{form}"
    with ExitStack() as stack:
        if is_file:
            path = stack.enter_context(replaced(target))
            sink = stack.enter_context(_sink(form, path, LONG, {}))
            for table, batch in _pieces(recording, tables, problems, reached):
                _write_long(sink, table, batch, problems)
            paths = [target]
        else:
            sinks = {
                table.port.topic: stack.enter_context(
                    _sink(form, stack.enter_context(replaced(path)), table.columns, _about(table))
                )
                for table, path in _files(tables, target, form)
            }
            for table, batch in _pieces(recording, tables, problems, reached):
                values = _values(table, batch, problems)
                if values is not None:
                    sinks[table.port.topic].write(values)
            paths = [path for _, path in _files(tables, target, form)]
            if form == "csv":
                paths.append(_describe(tables, target))
    return Exported(paths=paths, problems=list(problems.values()), lost=list(problems))


def _tables(recording: Recording) -> tuple[list[Table], dict[str, str]]:
    """Return the ports that can be read, and why the others cannot."""
    tables, problems = [], dict[str, str]()
    for port in recording.ports.values():
        if port.topic.startswith(_OWN):
            continue
        try:
            table = Table(port, recording.types)
        except StepbusError as exc:
            problems[port.topic] = unreadable(port, exc)
        else:
            if port.last_step >= 0:
                tables.append(table)
    if not tables:
        raise nothing_to_export(recording)
    return tables, problems


def _pieces(
    recording: Recording, tables: Sequence[Table], problems: Mapping[str, str], reached: Reached
) -> Iterator[tuple[Table, Batch]]:
    """Yield the pieces of all tables that still have no problem."""
    by_topic = {table.port.topic: table for table in tables}
    for piece in recording.batches([table.port for table in tables]):
        for topic, batch in piece.items():
            if len(batch.steps) and topic not in problems:
                yield by_topic[topic], batch
                reached(int(batch.steps[-1]))


def _values(table: Table, batch: Batch, problems: dict[str, str]) -> list[Cells] | None:
    try:
        return table.values(batch)
    except (StepbusError, ValueError) as exc:
        problems[table.port.topic] = (
            f"{table.port.topic}: {exc}; its rows end before step {batch.steps[0]}"
        )
        return None


def _write_long(sink: Sink, table: Table, batch: Batch, problems: dict[str, str]) -> None:
    """Write a row for each value of a piece, column by column."""
    values = _values(table, batch, problems)
    if values is None:
        return
    steps, t, count = batch.steps, batch.t, len(batch.steps)
    prefix = f"{table.port.participant}.{table.port.name}."
    for column, cells in zip(table.columns[len(CLOCK) :], values[len(CLOCK) :], strict=True):
        is_number = column.type in ("double", "int64", "bool")
        numbers = [None if cell is None else float(cell) for cell in cells] if is_number else None
        texts = None if is_number else [_text(cell) for cell in cells]
        empty = [None] * count
        name, unit = [prefix + column.name] * count, [column.unit] * count
        sink.write([steps, t, name, unit, numbers or empty, texts or empty])


def _text(cell: Any) -> str | None:
    match cell:
        case None:
            return None
        case bytes():
            return f"{len(cell)} bytes"
        case str():
            return cell
    return json.dumps(cell)


def _files(tables: Sequence[Table], folder: Path, form: str) -> list[tuple[Table, Path]]:
    rows = [(t, folder / f"{t.port.participant}.{t.port.name}.{form}") for t in tables]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise RecordingFailed(f"{folder} cannot be made: {exc.strerror or exc}") from exc
    return rows


def _about(table: Table) -> dict[str, str]:
    port = table.port
    return {
        "stepbus.port": port.topic,
        "stepbus.type": port.type,
        "stepbus.names": json.dumps(list(port.names)),
    }


def _describe(tables: Sequence[Table], folder: Path) -> Path:
    """Write the units and meanings of all columns, for CSV has no place for them."""
    path = folder / _COLUMNS_FILE
    with replaced(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["file", "column", "type", "unit", "description"])
        for table in tables:
            name = f"{table.port.participant}.{table.port.name}.csv"
            for one in table.columns:
                writer.writerow([name, one.name, one.type, one.unit, one.text])
    return path


def _sink(form: str, path: Path, columns: Sequence[Column], about: Mapping[str, str]) -> Sink:
    return _Csv(path, columns) if form == "csv" else _Parquet(path, columns, about)


class _Csv:
    """A CSV file. Absent: empty; vectors: JSON; bytes: how many there are."""

    def __init__(self, path: Path, columns: Sequence[Column]) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._types = [column.type for column in columns]
        self._writer = csv.writer(self._file)
        self._writer.writerow(column.name for column in columns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, values: Sequence[Cells]) -> None:
        """Write rows."""
        columns = [_plain(cells, form) for cells, form in zip(values, self._types, strict=True)]
        self._writer.writerows(zip(*columns, strict=True))


def _plain(cells: Cells, form: str) -> Sequence[Any]:
    """Return what CSV writes of a column."""
    if isinstance(cells, np.ndarray):
        plain: list[Any] = cells.tolist()
        return plain
    if form == "list":
        return [_text(cell) for cell in cells]
    return [_text(cell) if isinstance(cell, bytes) else cell for cell in cells]


class _Parquet:
    """A Parquet file, compressed with zstd; units are in the metadata of its fields."""

    def __init__(self, path: Path, columns: Sequence[Column], about: Mapping[str, str]) -> None:
        self._arrow, parquet = need("the export to Parquet", "pyarrow", "pyarrow.parquet")
        self._schema = self._arrow.schema(
            [self._field(column) for column in columns], metadata=dict(about)
        )
        floats = {c.name: "BYTE_STREAM_SPLIT" for c in columns if c.type == "double"}
        others = [c.name for c in columns if c.type in ("string", "json", "bool")]
        self._writer = parquet.ParquetWriter(
            path,
            self._schema,
            compression="zstd",
            use_dictionary=others or False,
            column_encoding=floats or None,
        )
        self._held: list[Any] = []

    def _field(self, column: Column) -> Any:
        arrow = self._arrow
        types = {
            "double": arrow.float64(),
            "int64": arrow.int64(),
            "bool": arrow.bool_(),
            "string": arrow.string(),
            "binary": arrow.binary(),
            "list": arrow.list_(arrow.float64()),
            "json": arrow.string(),
        }
        metadata = {"unit": column.unit, "description": column.text}
        return arrow.field(column.name, types[column.type], metadata=metadata)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self._flush()
            self._writer.close()
            return
        # What ended it is the reason; nobody reads the rest.
        with suppress(OSError, ValueError):
            self._writer.close()

    def write(self, values: Sequence[Cells]) -> None:
        """Write rows, in groups that read well."""
        arrow = self._arrow
        arrays = [
            arrow.array(cells, type=field.type)
            for cells, field in zip(values, self._schema, strict=True)
        ]
        self._held.append(arrow.table(arrays, schema=self._schema))
        rows = sum(table.num_rows for table in self._held)
        if rows >= _GROUP_ROWS or sum(t.nbytes for t in self._held) >= _GROUP_BYTES:
            self._flush()

    def _flush(self) -> None:
        if self._held:
            table = self._arrow.concat_tables(self._held).combine_chunks()
            self._writer.write_table(table, row_group_size=_GROUP_ROWS)
            self._held = []
