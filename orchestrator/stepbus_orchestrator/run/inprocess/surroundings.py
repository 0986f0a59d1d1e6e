"""What participants find around them, in the process that they share."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

from stepbus_participant import is_installed

NATIVE_LOG = "native.log"
"""Where libraries in C print, beside the logs of the participants."""


class Surroundings:
    """Lets participants work as in processes of their own, while it is entered.

    The scenario's folder is the working directory, and is searched first for modules, but not in
    the place of ours. What a run has loaded from there is known to the run, and forgotten with it:
    each run loads the files as they are then, and none gets what another folder calls alike.

    folder: of the scenario. files: that are imported by their path.
    """

    def __init__(self, folder: Path, files: Iterable[str]) -> None:
        self._folder = str(folder)
        self._outside = self._inside = -1
        names = {Path(file).stem for file in files} - sys.stdlib_module_names
        self._own: dict[str, ModuleType | None] = dict.fromkeys(names)
        self._others: dict[str, ModuleType] = {}
        self._path_outside = list(sys.path)
        self._path_inside = [self._folder, *sys.path]

    @contextlib.contextmanager
    def around(self, native_log: Path | None) -> Iterator[None]:
        """Enter it for a block, and leave the process as it was.

        native_log: where libraries in C print; None: on descriptors 1 and 2, which are
        not the run's. Raises OSError where the folder or the log cannot be opened.
        """
        with contextlib.ExitStack() as stack:
            self._inside = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            stack.callback(os.close, self._inside)
            stack.enter_context(_native_prints(native_log))
            sys.meta_path.insert(sys.meta_path.index(PathFinder), self)
            stack.callback(sys.meta_path.remove, self)
            self.enter()
            stack.callback(self.leave)
            yield

    def enter(self) -> None:
        """Put what participants find in place; harmless when repeated."""
        if self._outside >= 0:
            return
        # The working directory may have no name any more.
        self._outside = os.open(".", os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        os.fchdir(self._inside)
        self._path_outside, sys.path[:] = sys.path[:], self._path_inside
        for name, own in self._own.items():
            other = sys.modules.pop(name, None)
            if other is not None:
                self._others[name] = other
            if own is not None:
                sys.modules[name] = own

    def leave(self) -> None:
        """Put back what was there before; harmless when repeated."""
        if self._outside < 0:
            return
        self._path_inside, sys.path[:] = sys.path[:], self._path_outside
        if self._own:
            self._own = {name: sys.modules.pop(name, None) for name in self._own}
            sys.modules.update(self._others)
            self._others = {}
        os.fchdir(self._outside)
        os.close(self._outside)
        self._outside = -1

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module as `PathFinder` does, and note it if it is of the folder."""
        if self._outside < 0:
            return None
        spec = PathFinder.find_spec(name, path, target)
        origin = "" if spec is None else spec.origin or ""
        if not origin.startswith(self._folder + os.sep) or "site-packages" in origin:
            return spec
        if path is None and is_installed(name):
            return PathFinder.find_spec(name, [at for at in sys.path if at != self._folder], target)
        self._own.setdefault(name, None)
        return spec


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
