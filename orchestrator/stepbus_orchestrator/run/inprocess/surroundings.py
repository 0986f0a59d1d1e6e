"""What participants find around them, in the process that they share."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from .hub import Hub


@contextlib.contextmanager
def surroundings(folder: Path, hub: Hub, native_log: Path | None) -> Iterator[None]:
    """Let participants work as in processes of their own; leave everything as it was.

    folder: of the scenario; becomes the working directory. native_log: where libraries in C print;
    None: they print on descriptors 1 and 2, which are somebody else's.
    """
    before = Path.cwd(), list(sys.path), list(sys.argv), os._exit

    def leave(status: int) -> NoReturn:
        if hub.current is None:
            before[3](status)
        raise SystemExit(status)

    os.chdir(folder)
    os._exit = leave
    try:
        with _native_prints(native_log):
            yield
    finally:
        os.chdir(before[0])
        sys.path[:], sys.argv[:] = before[1:3]
        os._exit = before[3]


@contextlib.contextmanager
def _native_prints(log: Path | None) -> Iterator[None]:
    """Send descriptors 1 and 2 to a file, which stays if there is anything in it."""
    if log is None:
        yield
        return
    kept = [os.dup(number) for number in (1, 2)]
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
    try:
        for number in (1, 2):
            os.dup2(file, number)
        yield
    finally:
        # C keeps what it has printed until a buffer is full.
        ctypes.CDLL(None).fflush(None)
        for number, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, number)
            os.close(copy)
        if not os.fstat(file).st_size:
            log.unlink(missing_ok=True)
        os.close(file)
