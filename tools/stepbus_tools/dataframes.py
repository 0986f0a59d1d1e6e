"""Recordings as tables for pandas, and compared number by number, aligned by time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_participant import need, suggest
from stepbus_schemas import WiringError
from stepbus_tools.signals import Array

from .columns import NUMBERS, Cells, Column, ColumnType, Table, readable

MaskedArray = np.ma.MaskedArray[Any, Any]


def recording_frame(recording: Recording, signals: Sequence[str]) -> Any:
    """Return signals as a pandas DataFrame; see `Recording.frame`."""
    (pandas,) = need("a DataFrame", "pandas")
    tables, _ = readable(recording)
    for signal in signals:
        _check(recording, tables, signal)
    wanted = tuple(f"{signal.replace('/', '.', 1)}." for signal in signals)
    parts, units = [], dict[str, str]()
    for table in tables:
        # Never bytes, such as of pictures.
        chosen = {
            column.name: column
            for column in table.columns
            if column.type != "binary"
            and (not wanted or f"{table.name}.{column.name}.".startswith(wanted))
        }
        if chosen:
            t_ns, values = _read(recording, table, list(chosen.values()))
            rows = {
                f"{table.name}.{name}": _series(pandas, chosen[name], cells)
                for name, cells in values.items()
            }
            parts.append(pandas.DataFrame(rows, index=pandas.Index(t_ns * 1e-9, name="t")))
            units |= {f"{table.name}.{name}": c.unit for name, c in chosen.items() if c.unit}
    if not parts:
        raise RecordingFailed(f"{recording.path} has no numeric signals for a DataFrame")
    frame = pandas.concat(parts, axis=1).sort_index()
    frame.attrs["units"] = units
    return frame


def _check(recording: Recording, tables: Sequence[Table], signal: str) -> None:
    """Raise WiringError where the recording has no such signal."""
    parts = signal.replace("/", ".", 1).split(".", 2)
    port = recording[".".join(parts[:2])]
    names = [column.name for table in tables if table.port is port for column in table.columns]
    if len(parts) > 2 and not any(f"{name}.".startswith(f"{parts[2]}.") for name in names):
        raise WiringError(f"{port.topic} has no values {parts[2]!r}{suggest(parts[2], names)}")


def _series(pandas: Any, column: Column, cells: MaskedArray) -> Any:
    """Return the values of a column for pandas, of its declared type where that holds them all."""
    if column.type not in NUMBERS:
        return cells.data
    if column.type == "double":
        return cells.filled(np.nan)
    held = cells.data.copy()
    held[np.ma.getmaskarray(cells)] = None
    fits = column.type == "bool" or all(cell is None or cell < 2**63 for cell in held)
    types = {"bool": "boolean", "int64": "Int64"}
    return pandas.array(held, dtype=types[column.type] if fits else object)


def _read(
    recording: Recording, table: Table, columns: Sequence[Column]
) -> tuple[NDArray[np.int64], dict[str, MaskedArray]]:
    """Return the times of all messages [ns], and column → its values, masked where absent."""
    wanted = {column.name: column.type for column in columns}
    fields = [field for field in table.fields if any(one.name in wanted for one in field.columns)]
    names = [column.name for field in fields for column in field.columns]
    times: list[NDArray[np.int64]] = []
    cells: dict[str, list[Cells]] = {name: [] for name in wanted}
    for batch in recording.batches([table.port]):
        _, t_ns, _, *rows = table.values(batch[table.port.topic], [field.name for field in fields])
        times.append(np.asarray(t_ns))
        for name, row in zip(names, rows, strict=True):
            if name in wanted:
                cells[name].append(row)
    return np.concatenate(times), {name: _masked(cells[name], wanted[name]) for name in wanted}


def _masked(pieces: Sequence[Cells], form: ColumnType) -> MaskedArray:
    """Return values, masked where absent. Integers are objects: no float has all their digits."""
    arrays = [piece for piece in pieces if isinstance(piece, np.ndarray)]
    if form == "double" and len(arrays) == len(pieces):
        return np.ma.array(np.concatenate(arrays))
    lists = (piece.tolist() if isinstance(piece, np.ndarray) else piece for piece in pieces)
    objects = np.empty(sum(map(len, pieces)), dtype=object)
    objects[:] = list(chain.from_iterable(lists))
    absent = np.array([cell is None for cell in objects], dtype=bool)
    if form == "double":
        objects[absent] = np.nan
        return np.ma.array(objects.astype(float), mask=absent)
    return np.ma.array(objects, mask=absent)


@dataclass(frozen=True, kw_only=True)
class FieldError:
    """Error of one value of a port between two recordings: second minus first.

    port, field: such as `plant.joint_state`, `position.joint1`. unit: of all numbers here. count:
    messages in which both have the value. rmse: root of the mean square. share: of the first's own
    root mean square. mean: with its sign. max: largest size; at_s: when it was [s]. NaN is
    infinitely far from any number.
    """

    port: str
    field: str
    unit: str
    count: int
    rmse: float
    share: float
    mean: float
    max: float
    at_s: float

    def __str__(self) -> str:
        """Return its name and its RMSE."""
        return f"{self.port}.{self.field}: RMSE {self.rmse:.3g} {self.unit}".rstrip()


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison:
    """Two recordings compared, aligned by time.

    errors: error of every value that both have, in recorded order; `pandas.DataFrame(errors)`
    works. only_first, only_second: ports that only one of them has. span_s: start and end of the
    time in which both have messages [s].
    """

    first: str
    second: str
    errors: Sequence[FieldError]
    only_first: Sequence[str]
    only_second: Sequence[str]
    span_s: tuple[float, float]

    @property
    def worst(self) -> FieldError | None:
        """Return the value with the largest RMSE relative to its size; None if all agree."""
        apart = [error for error in self.errors if error.rmse > 0]
        return max(apart, key=lambda error: error.share, default=None)

    def __getitem__(self, name: str) -> FieldError:
        """Return one by `participant.port.field`; raises WiringError when there is none."""
        by_name = {f"{error.port}.{error.field}": error for error in self.errors}
        if name not in by_name:
            raise WiringError(f"no compared signal is named {name!r}{suggest(name, by_name)}")
        return by_name[name]

    def frame(self) -> Any:
        """Return a pandas DataFrame, a row for each number; raises ExtraMissing without pandas."""
        (pandas,) = need("a DataFrame", "pandas")
        return pandas.DataFrame(self.errors).set_index(["port", "field"])

    def __repr__(self) -> str:
        """Return how many numbers differ, and which most, in a line."""
        apart, worst = sum(error.max > 0 for error in self.errors), self.worst
        most = f", most {worst}" if worst is not None else ""
        return (
            f"<Comparison {self.first} and {self.second}: {apart} of {len(self.errors)} numbers "
            f"differ{most}>"
        )


def compare(first: Path, second: Path) -> Comparison:
    """Compare the numbers of two recordings, port by port; see `stepbus.compare`."""
    errors, times = list[FieldError](), list[NDArray[np.int64]]()
    with Recording(first) as one, Recording(second) as other:
        tables, others = ({table.name: table for table in readable(r)[0]} for r in (one, other))
        for name in [name for name in tables if name in others]:
            units = {c.name: c.unit for c in others[name].columns if c.type in NUMBERS}
            columns = [
                column
                for column in tables[name].columns
                if column.type in NUMBERS and units.get(column.name) == column.unit
            ]
            if columns:
                t_ns, pairs = _aligned(
                    _read(one, tables[name], columns), _read(other, others[name], columns)
                )
                times += [t_ns] if len(t_ns) else []
                apart = (_error(name, column, t_ns, *pairs[column.name]) for column in columns)
                errors += [error for error in apart if error is not None]
    return Comparison(
        first=str(first),
        second=str(second),
        errors=errors,
        only_first=[name for name in tables if name not in others],
        only_second=[name for name in others if name not in tables],
        span_s=(
            float(min((t_ns[0] for t_ns in times), default=0) * 1e-9),
            float(max((t_ns[-1] for t_ns in times), default=0) * 1e-9),
        ),
    )


_Read = tuple[NDArray[np.int64], Mapping[str, MaskedArray]]


def _aligned(
    one: _Read, other: _Read
) -> tuple[NDArray[np.int64], dict[str, tuple[MaskedArray, MaskedArray]]]:
    """Return times [ns], and column → what both have then.

    The times are those of the one with fewer messages, while both have some: what the other then
    holds is its newest, as an input would read it (P6.1).
    """
    (first, values), (second, others) = one, other
    start, end = max(first[0], second[0]), min(first[-1], second[-1])
    t_ns = min((t[(t >= start) & (t <= end)] for t in (first, second)), key=len)
    held, other_held = (np.searchsorted(t, t_ns, side="right") - 1 for t in (first, second))
    return t_ns, {name: (values[name][held], others[name][other_held]) for name in values}


def _error(
    port: str, column: Column, t_ns: NDArray[np.int64], first: MaskedArray, second: MaskedArray
) -> FieldError | None:
    """Return how far the values of a column are apart; None where no time has one in both."""
    known = ~(np.ma.getmaskarray(first) | np.ma.getmaskarray(second))
    if not known.any():
        return None
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        apart = _apart(first.data[known], second.data[known])
        rmse, worst = _rms(apart), int(np.argmax(np.abs(apart)))
        usual = first.data[known].astype(float)
        share = rmse / _rms(usual[np.isfinite(usual)]) if 0 < rmse < np.inf else rmse
        return FieldError(
            port=port,
            field=column.name,
            unit=column.unit,
            count=len(apart),
            rmse=float(rmse),
            share=float(share),
            mean=float(np.mean(apart)),
            max=float(abs(apart[worst])),
            at_s=float(t_ns[known][worst] * 1e-9),
        )


def _apart(first: NDArray[Any], second: NDArray[Any]) -> Array:
    """Return second minus first: 0 for two NaN, infinite for one and for opposite infinities."""
    apart = (second - first).astype(float)
    nan, other_nan = (np.isnan(values.astype(float)) for values in (first, second))
    is_same = (first == second) | (nan & other_nan)
    return np.where(is_same, 0.0, np.where(np.isnan(apart), np.inf, apart))


def _rms(values: Array) -> np.float64:
    return np.float64(np.sqrt(np.mean(values**2)))
