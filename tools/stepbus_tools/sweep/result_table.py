"""The table of a sweep: `results.parquet`, a row a run."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_participant import need
from stepbus_tools.sweep.journal import Journal
from stepbus_tools.sweep.sweep_metrics import Value
from stepbus_tools.sweep.trial import Row
from stepbus_tools.whole_file import replaced

TABLE_FILE = "results.parquet"
TIMES_FILE = "times.parquet"
_ROWS_A_GROUP = 4096
_FIXED = ("outcome", "exit_code", "reason", "participant", "steps", "sha256", "folder")


def write_table(journal: Journal, paths: Sequence[str], folder: Path) -> None:
    """Write the tables of all rows so far; nobody sees half of one.

    `results.parquet` has run, the axes, how the run ended, its metrics; the same bytes for the same
    sweep, wherever it ran. `times.parquet` has what differs. paths: of the axes.

    Raises RecordingFailed when one cannot be written.
    """
    types = _Types(paths)
    for row in journal.rows():
        types.take(row)
    arrays = types.columns()
    _write(folder / TABLE_FILE, arrays, (types.flat(row, arrays) for row in journal.rows()))
    columns = {"run": "int64", "wall_s": "double", "steps_per_s": "double", "where": "string",
               "attempts": "int64"}  # fmt: skip
    _write(folder / TIMES_FILE, columns, map(_times, journal.rows()))


class _Types:
    """The column types of a table, from all its rows: numbers stay numbers where all are."""

    def __init__(self, paths: Sequence[str]) -> None:
        self._values = dict.fromkeys(paths, "")
        self._metrics: dict[str, str] = {}
        self._has_errors = False

    def take(self, row: Row) -> None:
        for path, value in row.values.items():
            self._values[path] = _wider(self._values[path], value)
        for name, metric in row.metrics.items():
            self._metrics[name] = _wider(self._metrics.get(name, ""), metric)
        self._has_errors |= bool(row.metric_error)

    def columns(self) -> dict[str, str]:
        fixed = {name: "int64" if name in {"exit_code", "steps"} else "string" for name in _FIXED}
        metrics = {self._metric(name): of or "double" for name, of in sorted(self._metrics.items())}
        error = {"metric_error": "string"} if self._has_errors else {}
        values = {path: of or "string" for path, of in self._values.items()}
        return {"run": "int64", **values, **fixed, **metrics, **error}

    def _metric(self, name: str) -> str:
        """Return the column of a metric, which an axis or a column of ours may have the name of."""
        is_taken = name in self._values or name in _FIXED or name in {"run", "metric_error"}
        return f"metric.{name}" if is_taken else name

    def flat(self, row: Row, columns: Mapping[str, str]) -> dict[str, Any]:
        flat: dict[str, Any] = {
            "run": row.run,
            **row.values,
            **{name: getattr(row, name, None) for name in _FIXED},
            **{self._metric(name): value for name, value in row.metrics.items()},
            "metric_error": row.metric_error or None,
        }
        flat["folder"] = f"runs/{row.run:06}" if row.kept else None
        return {name: _cell(flat.get(name), of) for name, of in columns.items()}


def _wider(before: str, value: Any) -> str:
    """Return the type of a column that has a further value."""
    if value is None:
        return before
    if isinstance(value, bool):
        mine = "bool"
    elif isinstance(value, int) and abs(value) < 2**63:
        mine = "int64"
    elif isinstance(value, float):
        mine = "double"
    else:
        return "string"
    if before in {"", mine}:
        return mine
    return "double" if {before, mine} == {"int64", "double"} else "string"


def _cell(value: Any, of: str) -> Any:
    if value is None:
        return None
    if of == "string":
        return value if isinstance(value, str) else repr(value)
    return float(value) if of == "double" else value


def _times(row: Row) -> dict[str, Value]:
    speed = row.steps / row.wall_s if row.wall_s else None
    return {"run": row.run, "wall_s": row.wall_s, "steps_per_s": speed, "where": row.where,
            "attempts": row.attempts}  # fmt: skip


def _write(path: Path, columns: Mapping[str, str], rows: Iterable[Mapping[str, Any]]) -> None:
    arrow, parquet = need("a sweep", "pyarrow", "pyarrow.parquet")
    schema = arrow.schema([(name, _arrow_type(arrow, of)) for name, of in columns.items()])
    with replaced(path) as part, parquet.ParquetWriter(part, schema) as writer:
        for group in _groups(rows):
            writer.write_table(arrow.Table.from_pylist(group, schema=schema))


def _arrow_type(arrow: Any, of: str) -> Any:
    makers = {"int64": arrow.int64, "double": arrow.float64, "bool": arrow.bool_}
    return makers.get(of, arrow.string)()


def _groups(rows: Iterable[Mapping[str, Any]]) -> Iterator[list[Mapping[str, Any]]]:
    group = []
    for row in rows:
        group.append(row)
        if len(group) == _ROWS_A_GROUP:
            yield group
            group = []
    if group:
        yield group
