"""Bounds the log of a participant, which may print without end."""

import contextlib
import errno
import os
import resource
import tempfile
from pathlib import Path

_LARGEST = 8 * 1024 * 1024
_HEAD = _TAIL = 1024 * 1024
_CATCH_UPS = 20
_FULL = (errno.ENOSPC, errno.EDQUOT)
_PROBE = bytes(8192)


class BoundedLog:
    """A log file that a process appends to: past 8 MiB, its first and its last MiB are kept.

    The process must have opened it for appending. What it prints during a cut counts as cut.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._cut = 0
        self._mark = b""

    def limit(self) -> None:
        """Cut the file if it has become too large; harmless when it is gone."""
        with contextlib.suppress(OSError):
            if self._path.stat().st_size > _LARGEST:
                file = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
                try:
                    self._shorten(file)
                finally:
                    os.close(file)

    def problem(self) -> str:
        """Return why nothing more can be printed into the file; empty where it can."""
        try:
            with tempfile.TemporaryFile(dir=self._path.parent, buffering=0) as probe:
                probe.write(_PROBE)
            largest, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
            is_largest = largest not in {resource.RLIM_INFINITY, 0}
            if is_largest and self._path.stat().st_size >= largest:
                return os.strerror(errno.EFBIG)
        except OSError as exc:
            return os.strerror(exc.errno) if exc.errno in _FULL else ""
        return ""

    def _shorten(self, file: int) -> None:
        end = os.fstat(file).st_size
        tail = os.pread(file, _TAIL, end - _TAIL)
        for _ in range(_CATCH_UPS):
            # It may have printed meanwhile, perhaps its last words.
            more = os.pread(file, _TAIL, end)
            tail, end = (tail + more)[-_TAIL:], end + len(more)
            if not more:
                break
        self._cut += end - _HEAD - len(self._mark) - len(tail)
        self._mark = f"\n[stepbus: {self._cut} bytes are cut out here]\n".encode()
        os.ftruncate(file, _HEAD)
        os.write(file, self._mark + tail)
