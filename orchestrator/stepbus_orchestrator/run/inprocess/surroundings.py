"""What participants find around them, in the process that they share."""

import contextlib
import ctypes
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from stepbus_orchestrator.run.inprocess.program import ScenarioModules

from .guard import Guard

NATIVE_LOG = "native.log"
"""Where libraries in C print, beside the logs of the participants."""


class Surroundings:
    """Let participants work as in processes of their own; a context, left as it was entered.

    folder: of the scenario; becomes the working directory. modules: those of the folder. guard:
    keeps what a participant does to the process from the others. native_log: where libraries in C
    print; None: they print on descriptors 1 and 2, which are somebody else's. Raises OSError where
    the folder or the log cannot be opened.
    """

    def __init__(
        self, folder: Path, modules: ScenarioModules, guard: Guard, native_log: Path | None
    ) -> None:
        self._folder = folder
        self._modules = modules
        self._guard = guard
        self._native_log = native_log
        self._folder_outside = self._folder_inside = -1
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            outside = _here()
            stack.callback(os.close, outside)
            stack.callback(os.fchdir, outside)
            os.chdir(self._folder)
            inside = _here()
            stack.callback(os.close, inside)
            stack.enter_context(_native_prints(self._native_log))
            os.fchdir(outside)
            self._folder_inside = inside
            self._stack = stack.pop_all()
        self.enter()
        return self

    def __exit__(
        self,
        _type: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        self.leave()
        here = _here()
        try:
            self._stack.close()
        finally:
            os.fchdir(here)
            os.close(here)

    def enter(self) -> None:
        """Put what participants find in place."""
        self._folder_outside = _here()
        os.fchdir(self._folder_inside)
        self._guard.enter()
        self._modules.enter()

    def leave(self) -> None:
        """Put back what was there before."""
        self._modules.leave()
        self._guard.leave()
        os.fchdir(self._folder_outside)
        os.close(self._folder_outside)


def _here() -> int:
    """Return a descriptor of the working directory, which may have no name any more."""
    return os.open(".", os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)


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
