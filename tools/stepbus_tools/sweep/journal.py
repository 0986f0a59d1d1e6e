"""The rows of a sweep on disk: appended as they come, and made into one table.

`rows.jsonl` has one line a row, in the order in which they came, wall-clock times included. It is
what a sweep that was cut off resumes from; a last line that is half written is dropped.
`results.parquet` is made of it: sorted, without what differs from one time to the next.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Self

import msgspec

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_participant import append_to
from stepbus_schemas import UNDECODABLE, explained
from stepbus_tools.sweep.trial import Row

ROWS_FILE = "rows.jsonl"
_decode = msgspec.json.Decoder(Row).decode


class Journal:
    """Rows in a file; kept in memory is only where each of them is.

    Raises RecordingFailed where the file cannot be opened, or a row cannot be written: a full disk
    costs that row only.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / ROWS_FILE
        self._places: dict[int, tuple[int, int]] = {}
        """Run → where its line starts, and its length."""
        try:
            # No buffer: rows are written while others are read, and a buffer would be old.
            self._file = os.fdopen(append_to(self._path), "ab+", buffering=0)
        except OSError as exc:
            raise RecordingFailed(f"{self._path} cannot be opened: {exc.strerror}") from exc
        try:
            self._end = self._read()
            self._file.truncate(self._end)
        except RecordingFailed:
            self.close()
            raise
        except OSError as exc:
            self.close()
            raise RecordingFailed(f"{self._path} cannot be read: {exc.strerror}") from exc

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def _read(self) -> int:
        """Find all rows; return where the last whole one ends."""
        end = 0
        with self._path.open("rb") as file:
            for line in file:
                try:
                    if not line.endswith(b"\n"):
                        break
                    row = _decode(line)
                except UNDECODABLE as exc:
                    raise RecordingFailed(
                        f"{self._path}: byte {end} begins no row: it {explained(exc)}"
                    ) from exc
                self._places[row.run] = end, len(line)
                end += len(line)
        return end

    def __contains__(self, number: object) -> bool:
        """Return whether there is a row of a run."""
        return number in self._places

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._places)

    def add(self, row: Row) -> None:
        """Append a row; the file has all of it, or nothing."""
        line = memoryview(msgspec.json.encode(row) + b"\n")
        written = 0
        try:
            while written < len(line):
                written += os.write(self._file.fileno(), line[written:])
        except OSError as exc:
            with contextlib.suppress(OSError):
                self._file.truncate(self._end)
            raise RecordingFailed(
                f"{self._path} cannot be written: {exc.strerror}; all {len(self)} rows before are "
                "there, and the same command goes on from them"
            ) from exc
        self._places[row.run] = self._end, len(line)
        self._end += len(line)

    def row(self, number: int) -> Row:
        """Return the row of a run."""
        start, length = self._places[number]
        return _decode(os.pread(self._file.fileno(), length, start))

    def rows(self) -> Iterator[Row]:
        """Yield all rows by number."""
        return (self.row(number) for number in sorted(self._places))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
