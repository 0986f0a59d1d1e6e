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
    None: they print on descriptors 1 and 2, which are somebody else's. Raises OSError where the
    folder or the log cannot be opened.
    """
    end_process, path, argv = os._exit, list(sys.path), list(sys.argv)

    def leave(status: int) -> NoReturn:
        if hub.current is None:
            end_process(status)
        raise SystemExit(status)

    with _working_in(folder), _native_prints(native_log):
        os._exit = leave
        try:
            yield
        finally:
            os._exit = end_process
            sys.path[:], sys.argv[:] = path, argv


@contextlib.contextmanager
def _working_in(folder: Path) -> Iterator[None]:
    """Work in a folder, and go back to where we were, which may have no name any more."""
    before = os.open(".", os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.chdir(folder)
        yield
    finally:
        os.fchdir(before)
        os.close(before)


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
