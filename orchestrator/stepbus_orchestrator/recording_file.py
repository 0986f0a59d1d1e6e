"""A file that a full disk cannot spoil."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

_RESERVE_BYTES = 512 * 1024


class SteadyFile:
    """An append-only file of whole writes: one that fails leaves no half of it behind.

    Room to close the file properly is set aside beside it from the beginning, and given back by
    `release`, so that a recording on a full disk still ends with its index.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._position = 0
        self.closed = False
        self._reserve = path.with_name(f".{path.name}.reserve")
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        try:
            self._set_aside()
        except OSError:
            os.close(self._file)
            self._reserve.unlink(missing_ok=True)
            raise

    def _set_aside(self) -> None:
        reserve = os.open(self._reserve, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            os.posix_fallocate(reserve, 0, _RESERVE_BYTES)
        finally:
            os.close(reserve)

    def tell(self) -> int:
        """Return how much has been written [bytes]."""
        return self._position

    def write(self, data: bytes) -> int:
        """Append all of `data`, or nothing of it.

        Raises OSError, e.g. when the disk is full.
        """
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._file, rest) :]
        except OSError:
            os.ftruncate(self._file, self._position)
            os.lseek(self._file, self._position, os.SEEK_SET)
            raise
        self._position += len(data)
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def release(self) -> None:
        """Give back the room that was set aside."""
        self._reserve.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the file; harmless when repeated."""
        if not self.closed:
            self.closed = True
            with contextlib.suppress(OSError):
                os.close(self._file)
            self.release()
