"""Whether a file is being written: its writer holds a lock on it, which ends with the writer."""

import contextlib
import fcntl
import os
import struct
from pathlib import Path

from stepbus_participant import open_regular

_LOCK = struct.Struct("hhqqi0q")
"""`struct flock`: type, whence, start, length, process. A lock of an open file (OFD): unlike one of
a process, it does not end when that process opens and closes the same file once more."""


def lock(file: int) -> None:
    """Let others see that a file is being written; where its file system has no locks, nobody."""
    _set(file, fcntl.F_WRLCK)


def unlock(file: int) -> None:
    """Let others see that a file is complete; children that have inherited it do not matter."""
    _set(file, fcntl.F_UNLCK)


def _set(file: int, kind: int) -> None:
    with contextlib.suppress(OSError):
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, _LOCK.pack(kind, os.SEEK_SET, 0, 0, 0))


def is_being_written(path: Path) -> bool:
    """Return whether a recording is being written; not of a file that cannot be read."""
    try:
        file = open_regular(path)
    except OSError:
        return False
    try:
        return is_locked(file)
    finally:
        os.close(file)


def is_locked(file: int) -> bool:
    """Return whether somebody else is writing a file."""
    try:
        question = _LOCK.pack(fcntl.F_RDLCK, os.SEEK_SET, 0, 0, 0)
        answer = fcntl.fcntl(file, fcntl.F_OFD_GETLK, question)
    except OSError:
        return False
    kind: int = _LOCK.unpack(answer)[0]
    return kind != fcntl.F_UNLCK
