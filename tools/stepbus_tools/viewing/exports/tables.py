"""Tables of a recording: Parquet and CSV, one file for each port or all ports in one file."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np

from stepbus_orchestrator.recording import Recording
from stepbus_participant import need
from stepbus_schemas import MessageError, StepbusError
from stepbus_tools.columns import (
    CLOCK,
    LISTS,
    NUMBERS,
    Cells,
    Column,
    ColumnType,
    Table,
    distinct,
    pieces,
    readable,
    to_json,
)
from stepbus_tools.viewing.exports.exporter import Exported, Reached, nothing_to_export
from stepbus_tools.whole_file import replaced

_GROUP_ROWS = 100_000
_GROUP_BYTES = 16 * 1024 * 1024
"""Of a row group, whichever comes first."""
_COLUMNS_FILE = "columns.csv"
_LONG = (
    Column(name="step", type="int64", text="step of the message"),
    Column(name="t", type="double", unit="s", text="simulation time"),
    Column(name="signal", type="string", text="participant.port.column"),
    Column(name="unit", type="string", text="unit of the value"),
    Column(name="value", type="double", text="value, where it is a number"),
    Column(name="text", type="string", text="value, where no double holds it"),
)
"""The columns of a file with all ports: a row for each value."""


def _write(form: str, recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write the messages of all ports as `parquet` or `csv`.

    target: a folder, which gets one file for each port, `plant.joint_state.parquet`; or a file
    that ends in .parquet or .csv, which gets a row for each value.
    """
    sink: Callable[..., _Sink] = _Csv if form == "csv" else _Parquet
    if form == "parquet":
        need("the export to Parquet", "pyarrow", "pyarrow.parquet")
    tables, lost = readable(recording)
    if not tables:
        raise nothing_to_export(recording)
    is_file = target.suffix == f".{form}"
    paths = {} if is_file else {table: target / f"{table.name}.{form}" for table in tables}
    with ExitStack() as stack:

        def opened(path: Path, columns: Sequence[Column], about: Mapping[str, str]) -> _Sink:
            part = stack.enter_context(replaced(path))
            made = sink(part, columns, about)
            stack.enter_context(made)
            return made

        if is_file:
            sinks = dict.fromkeys(tables, opened(target, _LONG, {}))
        else:
            sinks = {t: opened(p, _wide(t), _about(t)) for t, p in paths.items()}
        for table, batch in pieces(recording, tables, lost):
            try:
                values = table.values(batch)
                for rows in _long(table, values) if is_file else [values]:
                    sinks[table].write(rows)
            except StepbusError as exc:
                end = f"its rows end before step {batch.steps[0]}"
                lost[table.port.topic] = f"{table.port.topic}: {exc}; {end}"
                continue
            reached(int(batch.steps[-1]))
    written = [target] if is_file else list(paths.values())
    if form == "csv" and not is_file:
        written.append(_describe(tables, target))
    renamed = [] if is_file else list(chain.from_iterable(map(_renamed, tables)))
    return Exported(paths=written, problems=[*renamed, *lost.values()], lost=list(lost))


def _wide(table: Table) -> list[Column]:
    """Return the columns of a port's file, with distinct names."""
    columns = [*CLOCK, *table.columns]
    names = distinct([column.name for column in columns])
    return [replace(column, name=name) for column, name in zip(columns, names, strict=True)]


def _renamed(table: Table) -> Iterator[str]:
    for old, new in zip(table.columns, _wide(table)[len(CLOCK) :], strict=True):
        if old.name != new.name:
            yield f"{table.port.topic}: {old.name} is in the column {new.name}; the name is taken"


def _long(table: Table, values: Sequence[Cells]) -> Iterator[Sequence[Cells]]:
    """Yield a row for each value of a piece, column by column."""
    steps, _, t, *cells_of = values
    count = len(steps)
    for column, cells in zip(table.columns, cells_of, strict=True):
        numbers: Cells = [None] * count
        texts: Cells = [None] * count
        if column.type in NUMBERS:
            numbers = [None if cell is None else float(cell) for cell in cells]
            # Integers that no double holds.
            is_cut = (isinstance(c, int | np.integer) and float(c) != int(c) for c in cells)
            texts = [str(c) if cut else None for c, cut in zip(cells, is_cut, strict=True)]
        else:
            texts = [_text(cell) for cell in cells]
        name = f"{table.name}.{column.name}"
        yield steps, t, [name] * count, [column.unit] * count, numbers, texts


def _text(cell: Any) -> str | None:
    match cell:
        case None:
            return None
        case bytes():
            return f"{len(cell)} bytes"
        case str():
            return cell
    return to_json(cell)


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
            for one in _wide(table):
                writer.writerow([f"{table.name}.csv", one.name, one.type, one.unit, one.text])
    return path


class _Csv:
    """A CSV file. Absent: empty; vectors: JSON; bytes: how many there are."""

    def __init__(self, path: Path, columns: Sequence[Column], _about: Mapping[str, str]) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._types = [column.type for column in columns]
        self._writer = csv.writer(self._file)
        self._writer.writerow(column.name for column in columns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, values: Sequence[Cells]) -> None:
        """Write rows. values: of each column."""
        columns = [_written(*pair) for pair in zip(values, self._types, strict=True)]
        self._writer.writerows(zip(*columns, strict=True))


def _written(cells: Cells, form: ColumnType) -> Sequence[Any]:
    """Return cells as CSV has them. Polars reads a column with `nan` as text, with `NaN` not."""
    if form in (*LISTS, "binary"):
        return [_text(cell) for cell in cells]
    plain: Sequence[Any] = cells.tolist() if isinstance(cells, np.ndarray) else cells
    if form != "double":
        return plain
    return ["NaN" if isinstance(cell, float) and math.isnan(cell) else cell for cell in plain]


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
        self._rows = self._bytes = 0

    def _field(self, column: Column) -> Any:
        arrow, form = self._arrow, column.type
        if form in LISTS:
            kind = arrow.list_(arrow.type_for_alias(form[5:-1]))
        else:
            kind = arrow.type_for_alias("string" if form == "json" else form)
        metadata = {"unit": column.unit, "description": column.text}
        return arrow.field(column.name, kind, metadata=metadata)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self._flush()
            self._writer.close()
            return
        # What ended it is the reason; the rest does not matter.
        with suppress(OSError, ValueError):
            self._writer.close()

    def write(self, values: Sequence[Cells]) -> None:
        """Write rows, in groups that read well; raises MessageError for an integer above int64."""
        fields = zip(values, self._schema, strict=True)
        arrays = [self._array(cells, field) for cells, field in fields]
        table = self._arrow.table(arrays, schema=self._schema)
        self._held.append(table)
        self._rows += table.num_rows
        self._bytes += table.nbytes
        if self._rows >= _GROUP_ROWS or self._bytes >= _GROUP_BYTES:
            self._flush()

    def _array(self, cells: Cells, field: Any) -> Any:
        try:
            return self._arrow.array(cells, type=field.type)
        except (OverflowError, self._arrow.ArrowInvalid) as exc:
            raise MessageError(
                f"{field.name} has an integer above {2**63 - 1}, too large for {field.type}; "
                "export it as CSV"
            ) from exc

    def _flush(self) -> None:
        if self._held:
            table = self._arrow.concat_tables(self._held).combine_chunks()
            self._writer.write_table(table, row_group_size=_GROUP_ROWS)
            self._held, self._rows, self._bytes = [], 0, 0


_Sink = _Csv | _Parquet

write_csv, write_parquet = partial(_write, "csv"), partial(_write, "parquet")
