"""Reads a table of numbers from a CSV file, and reports every mistake with its line."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from stepbus_participant import read_text, suggest
from stepbus_schemas import WiringError

_DERIVATIVES = ("velocity", "acceleration")
_MOST_PROBLEMS = 10


@dataclass(frozen=True, kw_only=True)
class Table:
    """times: increasing, shape (k,), k ≥ 2 [s]. columns: name → numbers, shape (k,)."""

    times: list[float]
    columns: dict[str, list[float]]


def read_table(path: Path, joints: Sequence[str]) -> Table:
    """Return the columns `t`, `<joint>`, `<joint>_velocity` and `<joint>_acceleration` of a file.

    Raises WiringError that lists all mistakes of the header, or else of the rows, each with file
    and line.
    """
    try:
        reader = csv.reader(io.StringIO(read_text(path, "utf-8-sig")))
        lines = [(reader.line_num, row) for row in reader if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as exc:
        reason = exc.strerror if isinstance(exc, OSError) else exc
        raise WiringError(f"cannot read {path} as CSV: {reason}") from exc
    if len(lines) < 3:
        raise WiringError(f"{path} has {len(lines)} lines; it needs a header and at least two rows")
    (first, names), *rows = lines
    header = [name.strip() for name in names]
    _refuse([f"{path}:{first}: {text}" for text in _header_problems(header, joints)])
    table = [[_number(cell) for cell in row] for _, row in rows]
    _refuse(
        [
            f"{path}:{line}: {text}"
            for (line, row), numbers in zip(rows, table, strict=True)
            for text in _row_problems(header, row, numbers)
        ]
    )
    columns = dict(zip(header, map(list, zip(*table, strict=True)), strict=True))
    times = columns.pop("t")
    later = pairwise(zip(times, [line for line, _ in rows], strict=True))
    _refuse(
        [f"{path}:{rows[0][0]}: t starts at {times[0]:g} s; it must be at least 0"]
        if times[0] < 0
        else [
            f"{path}:{line}: t is {now:g} s; it must increase (previous row: {before:g} s)"
            for (before, _), (now, line) in later
            if now <= before
        ]
    )
    return Table(times=times, columns=columns)


def _header_problems(header: Sequence[str], joints: Sequence[str]) -> Iterator[str]:
    known = ["t", *joints]
    known += [f"{joint}_{quantity}" for joint in joints for quantity in _DERIVATIVES]
    different = dict.fromkeys(header)
    yield from (f"column {n!r} is unknown{suggest(n, known)}" for n in different if n not in known)
    yield from (f"column {name!r} is missing" for name in ("t", *joints) if name not in header)
    for name in different:
        if header.count(name) > 1:
            yield f"column {name!r} occurs {header.count(name)} times"
    for joint in joints:
        if f"{joint}_acceleration" in header and f"{joint}_velocity" not in header:
            yield f"column '{joint}_acceleration' needs '{joint}_velocity' too"


def _row_problems(
    header: Sequence[str], row: Sequence[str], numbers: Sequence[float]
) -> Iterator[str]:
    if len(row) != len(header):
        yield f"has {len(row)} cells, the header has {len(header)}"
    for name, cell, number in zip(header, row, numbers, strict=False):
        if not math.isfinite(number):
            yield f"column {name!r} is {cell!r}, not a finite number"


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _refuse(problems: Sequence[str]) -> None:
    if problems:
        raise WiringError("\n".join(problems[:_MOST_PROBLEMS]))
