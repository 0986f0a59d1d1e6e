"""The rows of a sweep on disk: appended as they come, and made into one table.

`rows.jsonl` has one line a row, in the order in which they came, wall-clock times included. It is
what a sweep that was cut off resumes from; a last line that is half written is dropped.
`results.parquet` is made of it: sorted, without what differs from one time to the next.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import msgspec

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_participant import append_to, need
from stepbus_schemas import UNDECODABLE, explained
from stepbus_tools.columns import distinct
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.sweep_metrics import Value
from stepbus_tools.whole_file import replaced

ROWS_FILE = "rows.jsonl"
TABLE_FILE = "results.parquet"
TIMES_FILE = "times.parquet"
_ROWS_A_GROUP = 4096
_FIXED = ("outcome", "exit_code", "reason", "participant", "steps", "sha256", "folder")
_TIMES = ("run", "wall_s", "steps_per_s", "where", "attempts")


class ResultRow(msgspec.Struct, frozen=True, kw_only=True):
    """What a sweep knows of one run.

    reason: how it ended, without what only the machine knows. metrics: name → value.
    metric_error: why the user's metrics have none. wall_s, where, attempts: of this time only.
    """

    run: int
    values: dict[str, Any]
    outcome: str
    exit_code: int
    reason: str = ""
    participant: str | None = None
    steps: int = 0
    sha256: str = ""
    kept: bool = False
    metrics: dict[str, Value] = {}
    metric_error: str = ""
    wall_s: float = 0.0
    where: str = ""
    attempts: int = 1

    @property
    def steps_per_s(self) -> float | None:
        """Return the steps per second of the wall clock; None where that is unknown."""
        return self.steps / self.wall_s if self.wall_s else None

    @property
    def folder(self) -> str | None:
        """Return the folder of a run that stays, in that of its sweep."""
        return f"runs/{self.run:06}" if self.kept else None


def failed_row(point: Point, outcome: str, reason: str, code: int) -> ResultRow:
    """Return the row of a run that has no result of its own."""
    return ResultRow(
        run=point.number,
        values=dict(point.values),
        outcome=outcome,
        exit_code=code,
        reason=reason,
        metrics={"success": False},
    )


_decode = msgspec.json.Decoder(ResultRow).decode


class Journal(Mapping[int, ResultRow]):
    """Number → row of each run that has one, by number; in a file, and in memory.

    Raises RecordingFailed where the file cannot be opened, or a row cannot be written: a full disk
    costs that row only.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / ROWS_FILE
        self._rows: dict[int, ResultRow] = {}
        self._end = 0
        try:
            known = self._path.read_bytes() if self._path.exists() else b""
            for line in known.splitlines(keepends=True):
                if line.endswith(b"\n"):
                    self._take(_decode(line), line)
            self._file = os.fdopen(append_to(self._path), "ab")
            self._file.truncate(self._end)
        except OSError as exc:
            raise RecordingFailed(f"{self._path} cannot be read: {exc.strerror}") from exc
        except UNDECODABLE as exc:
            raise RecordingFailed(
                f"{self._path}: byte {self._end} is not the start of a row: {explained(exc)}"
            ) from exc

    def _take(self, row: ResultRow, line: bytes) -> None:
        self._rows[row.run] = row
        self._end += len(line)

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

    def __getitem__(self, number: int) -> ResultRow:
        """Return the row of a run."""
        return self._rows[number]

    def __iter__(self) -> Iterator[int]:
        """Yield the numbers in order."""
        return iter(sorted(self._rows))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._rows)

    def add(self, row: ResultRow) -> None:
        """Append a row; the file has all of it, or nothing."""
        line = msgspec.json.encode(row) + b"\n"
        written = 0
        try:
            while written < len(line):
                written += os.write(self._file.fileno(), line[written:])
        except OSError as exc:
            with contextlib.suppress(OSError):
                self._file.truncate(self._end)
            raise RecordingFailed(
                f"{self._path} cannot be written: {exc.strerror}; all {len(self)} "
                "earlier rows are kept; run the same command again to resume"
            ) from exc
        self._take(row, line)


def write_table(journal: Journal, paths: Sequence[str], folder: Path) -> None:
    """Write the tables of all rows so far; no reader sees half of one.

    `results.parquet` has run, the axes, how the run ended, its metrics; the same bytes for the same
    sweep, wherever it ran. `times.parquet` has what differs. paths: of the axes.

    Raises RecordingFailed when one cannot be written.
    """
    arrow, parquet = need("a sweep", "pyarrow", "pyarrow.parquet")
    names = sorted({name for row in journal.values() for name in row.metrics})
    # An axis may have the name of a column of ours, and a metric that of both.
    ours = ("run", *_FIXED, "metric_error")
    axes = dict(zip(paths, distinct(paths, ours), strict=True))
    taken = {*ours, *axes.values()}
    wanted = [f"metric.{name}" if name in taken else name for name in names]
    metrics = dict(zip(names, distinct(wanted, taken), strict=True))
    rows = list(journal.values())
    columns: dict[str, list[Any]] = {
        "run": [row.run for row in rows],
        **{column: [row.values.get(path) for row in rows] for path, column in axes.items()},
        **{name: [getattr(row, name) for row in rows] for name in _FIXED},
        **{column: [row.metrics.get(name) for row in rows] for name, column in metrics.items()},
    }
    if any(row.metric_error for row in rows):
        columns["metric_error"] = [row.metric_error or None for row in rows]
    times = {name: [getattr(row, name) for row in rows] for name in _TIMES}
    empty = {
        **dict.fromkeys(("run", "exit_code", "steps", "attempts"), arrow.int64()),
        **dict.fromkeys((*metrics.values(), "wall_s", "steps_per_s"), arrow.float64()),
    }
    for file, content in ((TABLE_FILE, columns), (TIMES_FILE, times)):
        arrays = {
            name: _array(arrow, cells, empty.get(name, arrow.string()))
            for name, cells in content.items()
        }
        with replaced(folder / file) as part:
            parquet.write_table(arrow.table(arrays), part, row_group_size=_ROWS_A_GROUP)


def _array(arrow: Any, cells: Sequence[Any], empty: Any) -> Any:
    """Return a column: of numbers where all are, else of texts; empty: its type without any."""
    types: set[type] = {type(cell) for cell in cells if cell is not None}
    if not types:
        return arrow.array(cells, empty)
    is_plain = types == {int, float} or (len(types) == 1 and types < {bool, float, int, str})
    if is_plain and float in types:
        cells = [None if cell is None else float(cell) for cell in cells]
    try:
        return arrow.array(cells if is_plain else list(map(_text, cells)))
    except OverflowError:
        return arrow.array(list(map(_text, cells)))


def _text(cell: Any) -> str | None:
    return cell if cell is None or isinstance(cell, str) else repr(cell)
