"""The programs of a run in one process, and the modules that they share."""

import importlib
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.run.extensions.hosted_caller import Seat
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, start_command
from stepbus_participant import import_participant, is_installed, main
from stepbus_schemas import WiringError


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


_BRIDGE = ("stepbus", "bridge")


def check_programs(scenario: Scenario) -> None:
    """Raise WiringError, with all of them, for participants that need a process of their own."""
    problems = [
        f"participants.{spec.name}: `{' '.join(spec.exec)}` is a program of its own; "
        f"{_remedy(spec)}leave out {argument('--in-process')}"
        for spec in scenario.participants
        if not (spec.participant or _is_bridged(spec))
    ]
    if problems:
        raise WiringError("\n".join(problems))


def _is_bridged(spec: ParticipantSpec) -> bool:
    return spec.bridge is not None or spec.exec[:2] == _BRIDGE


def _remedy(spec: ParticipantSpec) -> str:
    """Return what to write instead of a program in Python."""
    if spec.exec[:1] != ("python",):
        return ""
    files = [word for word in spec.exec if word.endswith(".py")]
    name = f"{files[0]}:CLASS" if files else "MODULE:CLASS"
    return f"write `participant: {name}` instead of `exec`, with the name of its class, or "


def program_of(spec: ParticipantSpec, folder: Path, seat: Seat | None) -> Callable[[], int]:
    """Return what takes part and returns the exit code; the class is imported when it is called."""
    if seat is not None and seat.name == spec.name:
        return lambda: main(seat.make)
    if not spec.participant:
        return lambda: _bridge(spec, folder)
    return lambda: _take_part(spec.participant, folder)


def _take_part(name: str, folder: Path) -> int:
    try:
        factory = import_participant(name, folder)
    except WiringError as exc:
        raise SystemExit(str(exc)) from None
    return main(factory)


def _bridge(spec: ParticipantSpec, folder: Path) -> int:
    command = start_command(spec, folder)
    arguments = command[command.index("stepbus_bridge") + 1 :]
    return main(importlib.import_module("stepbus_bridge").bridge_to(arguments))
