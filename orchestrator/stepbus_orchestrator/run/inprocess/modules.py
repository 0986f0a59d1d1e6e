"""Modules of a scenario's folder, in the process of a run that imports them."""

import os
import sys
from collections.abc import Iterable, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from stepbus_participant import is_installed


class ScenarioModules:
    """What a run has loaded from its scenario's folder: known to the run, and forgotten with it.

    So each run loads the files as they are then, and none gets what another folder calls alike.
    While it is entered, the folder is searched first, but not in the place of modules of ours.
    files: that are imported by their path.
    """

    def __init__(self, folder: Path, files: Iterable[str]) -> None:
        self._folder = str(folder)
        names = {Path(file).stem for file in files} - sys.stdlib_module_names
        self._own: dict[str, ModuleType | None] = dict.fromkeys(names)
        self._others: dict[str, ModuleType] = {}
        self._all: dict[str, ModuleType] = {}
        self._path_outside = list(sys.path)
        self._path_inside = [self._folder, *sys.path]

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module as `PathFinder` does, and note it if it is of the folder."""
        spec = PathFinder.find_spec(name, path, target)
        if spec is None or not self._is_below(spec.origin or ""):
            return spec
        if path is None and is_installed(name):
            return PathFinder.find_spec(name, [at for at in sys.path if at != self._folder], target)
        self._own.setdefault(name, None)
        return spec

    def has_written(self, content: dict[str, Any]) -> bool:
        """Return whether code with these globals is the scenario's, not a library's."""
        file, name = content.get("__file__") or "", content.get("__name__", "")
        # A scenario may lie in a checkout of stepbus, or above it.
        return self._is_below(file) and not is_installed(name)

    def _is_below(self, file: str) -> bool:
        return file.startswith(self._folder + os.sep) and "site-packages" not in file

    def enter(self) -> None:
        """Put the folder and its modules in place."""
        self._path_outside, sys.path[:] = list(sys.path), self._path_inside
        for name, own in self._own.items():
            other = sys.modules.pop(name, None)
            if other is not None:
                self._others[name] = other
            if own is not None:
                sys.modules[name] = own
        sys.meta_path.insert(sys.meta_path.index(PathFinder), self)
        self.keep()

    def keep(self) -> None:
        """Note what is loaded, and put back what a participant has removed: others need it."""
        if len(sys.modules) < len(self._all):
            sys.modules.update(self._all)
        elif len(sys.modules) > len(self._all):
            self._all = dict(sys.modules)

    def leave(self) -> None:
        """Take the folder and its modules away."""
        self.keep()
        sys.meta_path.remove(self)
        self._path_inside, sys.path[:] = list(sys.path), self._path_outside
        self._own = {name: sys.modules.pop(name, None) for name in self._own}
        sys.modules.update(self._others)
        self._others, self._all = {}, {}
