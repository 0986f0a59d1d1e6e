"""Python programs, run in this process as `python` would run them in one of their own."""

import importlib
import importlib.util
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Protocol

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.run.extensions.hosted_caller import Seat
from stepbus_orchestrator.scenario import (
    ParticipantSpec,
    Scenario,
    is_installed_package,
    python_target,
)
from stepbus_participant import main, read_file
from stepbus_schemas import WiringError

_MAIN = "__main__"


def check_programs(scenario: Scenario) -> None:
    """Raise WiringError, with all of them, for participants that need a process of their own."""
    problems = [
        f"participants.{spec.name}: {why}"
        for spec in scenario.participants
        for why in [_why_not(spec)]
        if why is not None
    ]
    if problems:
        raise WiringError("\n".join([*problems, f"leave out {argument('--in-process')}"]))


def _why_not(spec: ParticipantSpec) -> str | None:
    if spec.bridge is not None or spec.exec[:2] == ("stepbus", "bridge"):
        return None
    program, *arguments = spec.exec
    if program != "python":
        return f"`{program}` is a program of its own; only `python` runs in one process"
    launch, _ = python_target(arguments)
    if not launch:
        return f"`{' '.join(spec.exec)}` names neither a module nor a script"
    if arguments[0].startswith("-") and arguments[0] != "-m":
        return f"the interpreter's option {arguments[0]} needs an interpreter of its own"
    return None


class Runnable(Protocol):
    """What a hosted participant executes."""

    def run(self) -> None:
        """Execute it to its end; raises what it raises, SystemExit included."""

    def enter(self) -> None:
        """Put its own arguments and modules in place."""

    def leave(self) -> None:
        """Take its own arguments and modules away."""

    def has_written(self, content: dict[str, Any]) -> bool:
        """Return whether code with these globals is its own, not a library's."""


class Guest:
    """A participant that is no program: code of this process, with its arguments and modules."""

    def __init__(self, seat: Seat) -> None:
        self._seat = seat

    def run(self) -> None:
        """Take part; raises SystemExit."""
        raise SystemExit(main(self._seat.make))

    def enter(self) -> None:
        """Do nothing."""

    def leave(self) -> None:
        """Do nothing."""

    def has_written(self, _content: dict[str, Any]) -> bool:
        """Return False: what our caller does, it does to its own process."""
        return False


class Program:
    """The `__main__` module of one participant, and the modules of its own folder.

    command: as `python` gets it, from `-m` or the script on. folder: its working directory. Modules
    of that folder are loaded for each participant anew, as in a process of its own: what one keeps
    in them, no other sees.
    """

    def __init__(self, command: Sequence[str], folder: Path) -> None:
        self._command = list(command)
        self._own = {_MAIN: ModuleType(_MAIN)}
        self._others: dict[str, ModuleType | None] = {}
        self._before: dict[str, ModuleType] = {}
        launch, name = python_target(command)
        self._argv = ["-m", *self._command[self._command.index(name) + 1 :]]
        self._argv_before = sys.argv
        self._module = name if launch == "module" else ""
        self._script = folder / name
        # `python -m` puts the working directory first, `python script` the folder of the script.
        self._path = str(folder if self._module else self._script.parent.resolve())
        # `python -P` puts none.
        self._is_searched = "-P" not in self._command[: self._command.index(name)]

    def run(self) -> None:
        """Execute it to its end; raises what it raises, SystemExit included."""
        main = self._own[_MAIN]
        code = self._module_code(main) if self._module else self._script_code(main)
        self._argv[0] = str(main.__file__)
        exec(code, main.__dict__)  # noqa: S102  (it is what the user asks to run)

    def _script_code(self, main: ModuleType) -> CodeType:
        path = self._script / "__main__.py" if self._script.is_dir() else self._script
        main.__file__ = str(path)
        return compile(read_file(path), str(path), "exec", dont_inherit=True)

    def _module_code(self, main: ModuleType) -> CodeType:
        spec = importlib.util.find_spec(self._module)
        if spec is not None and spec.submodule_search_locations:
            spec = importlib.util.find_spec(f"{self._module}.{_MAIN}")
        loader = getattr(spec, "loader", None)
        if spec is None or loader is None:
            raise ImportError(f"No module named {self._module}")
        main.__spec__, main.__file__, main.__package__ = spec, spec.origin, spec.parent
        code: CodeType = loader.get_code(spec.name)
        return code

    def enter(self) -> None:
        """Put its own arguments and modules in place."""
        modules = sys.modules
        self._argv_before, sys.argv = sys.argv, self._argv
        if self._is_searched:
            sys.path.insert(0, self._path)
        if len(self._own) > 1:
            self._others = {name: modules.get(name) for name in self._own}
            modules.update(self._own)
        else:
            self._others[_MAIN] = modules[_MAIN]
            modules[_MAIN] = self._own[_MAIN]
        if len(modules) != len(self._before):
            self._before = dict(modules)

    def leave(self) -> None:
        """Take its own arguments and modules away, with those it has loaded meanwhile."""
        modules = sys.modules
        sys.argv = self._argv_before
        if self._is_searched and self._path in sys.path:
            sys.path.remove(self._path)
        if len(modules) < len(self._before):
            # It has removed some, which are the others' as well.
            modules.update(self._before)
        if len(modules) != len(self._before):
            for name, module in tuple(modules.items()):
                if name not in self._own and self._is_own(name, getattr(module, "__dict__", {})):
                    self._own[name], self._others[name] = module, None
        for name, other in self._others.items():
            if other is None:
                modules.pop(name, None)
            else:
                modules[name] = other

    def has_written(self, content: dict[str, Any]) -> bool:
        """Return whether code with these globals is its own, not a library's."""
        name = content.get("__name__", _MAIN)
        return name == _MAIN or self._is_own(name, content)

    def _is_own(self, name: str, content: Mapping[str, Any]) -> bool:
        """Return whether a module is of the participant's folder, and of no package installed."""
        file = content.get("__file__") or ""
        is_below = file.startswith(self._path + os.sep) and "site-packages" not in file
        # A scenario may lie in a checkout of stepbus, or above it.
        return is_below and not is_installed_package(name)
