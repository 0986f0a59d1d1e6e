"""The configuration of one participant: parameters, ports, and classes that a scenario chooses."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from stepbus_schemas import (
    SHIPPED,
    InputConfig,
    OutputConfig,
    Types,
    Welcome,
    WiringError,
    error_text,
)

from .files import find_file
from .parameters.problems import Problems
from .parameters.read import read
from .parameters.settings import Settings

S = TypeVar("S", bound=Settings)


@dataclass(frozen=True, kw_only=True)
class Config:
    """The part of the scenario that concerns one participant.

    name: its name. params: its `params`, as written in the scenario. step_ns: length of a step
    [ns]. every: it fires at multiples of this [steps]. seed: seed of its own, derived from the
    run's seed and its name. folder: what relative file names are relative to. publishes: `first`
    or `last`, before or after it reads its inputs. types: message types by name, such as
    `config.types["Thruster/1"]`, with those of the scenario.
    """

    name: str
    step_ns: int
    every: int
    seed: int
    folder: Path
    inputs: Mapping[str, InputConfig]
    outputs: Mapping[str, OutputConfig]
    params: Mapping[str, Any]
    publishes: str = "last"
    types: Types = SHIPPED

    @classmethod
    def from_welcome(cls, welcome: Welcome, types: Types = SHIPPED) -> Config:
        """Return the user's view of a `Welcome`."""
        return cls(
            name=welcome.name,
            step_ns=welcome.step_ns,
            every=welcome.every,
            seed=welcome.seed,
            folder=Path(welcome.folder),
            inputs=welcome.inputs,
            outputs=welcome.outputs,
            params=welcome.params,
            publishes=welcome.publishes,
            types=types,
        )

    def param(self, name: str, default: Any = None) -> Any:
        """Return one parameter, or `default` where the scenario does not set it."""
        return self.params.get(name, default)

    def path(self, name: str) -> Path:
        """Return the file a parameter names.

        name: absolute, relative to the scenario's folder, or `package://<package>/<path>`, where
        the package is an installed Python package or a folder of `cmeel.prefix/share`.
        Raises WiringError when there is no such file.
        """
        try:
            return find_file(name, self.folder)
        except WiringError as exc:
            raise WiringError(f"participants.{self.name}.params: {exc}") from exc

    def read(self, settings: type[S], problems: Problems | None = None) -> S:
        """Return `params` as the settings that declare them.

        problems: what is wrong besides, with the ports say. Raises SettingsError that lists it,
        and everything that is wrong with the params.
        """
        problems = self.problems() if problems is None else problems
        params = read(settings, self.params, problems.below(("params",)), folder=self.folder)
        problems.refuse()
        return params

    def problems(self) -> Problems:
        """Return an empty collector of problems, for keys of this participant."""
        return Problems(above=("participants", self.name))


def make_plugin(
    config: Config, key: str, name: str, own: Mapping[str, Any], method: str, *args: Any
) -> Any:
    """Return an instance of a class of the user's own, made from `args` and its parameters.

    key: the parameter that names the class, `module:Class`. own: its parameters: it gets them as
    the settings that its attribute `Params` declares, or else as a map. method: what it has to
    have. Raises SettingsError that lists every problem.
    """
    problems = config.problems().below(("params",))
    cls = problems.attempt((key,), lambda: load_class(name, config.folder))
    if cls is not None and not callable(getattr(cls, method, None)):
        problems.add((key,), f"class {name} has no method {method!r}")
    problems.refuse()
    declared = getattr(cls, "Params", None)
    params = own if declared is None else read(declared, own, problems, folder=config.folder)
    problems.refuse()
    made = problems.attempt((key,), lambda: _make(cls, *args, params))
    problems.refuse()
    return made


def _make(wanted: Any, *args: Any) -> Any:
    try:
        return wanted(*args)
    except WiringError:
        raise
    except Exception as exc:
        raise WiringError(f"{wanted.__name__} cannot be made: {error_text(exc)}") from exc


def load_class(name: str, folder: Path) -> type[Any]:
    """Return the class that `module:Class` names.

    folder: searched first, before the installed modules. Raises WiringError when there is no such
    module or class in it, or when the module cannot be imported.
    """
    module_name, _, class_name = name.partition(":")
    if not module_name or not class_name.isidentifier():
        raise WiringError(f"{name!r} is not of the form module:Class")
    module = _import(module_name, folder)
    attribute = getattr(module, class_name, None)
    if not isinstance(attribute, type):
        raise WiringError(f"module {module_name!r} ({_file(module)}) has no class {class_name!r}")
    return attribute


def _import(module_name: str, folder: Path) -> Any:
    """Import a module with `folder` searched first, and only for this import."""
    sys.path.insert(0, str(folder))
    try:
        importlib.invalidate_caches()
        return importlib.import_module(module_name)
    except ModuleNotFoundError as exc:
        text = f"no module {exc.name!r} in {folder} or installed"
        raise WiringError(text if exc.name == module_name else f"{module_name}: {text}") from exc
    except Exception as exc:
        raise WiringError(f"module {module_name!r} cannot be imported: {error_text(exc)}") from exc
    finally:
        sys.path.remove(str(folder))


def _file(module: Any) -> str:
    return getattr(module, "__file__", None) or "built in"


class Ports:
    """Finds ports by message type, where the scenario is free to name them.

    problems: what does not fit is added there, and an empty name returned; give them to
    `Config.read`, which refuses with all that is wrong.
    """

    def __init__(self, config: Config) -> None:
        self.problems = config.problems()
        self._config = config

    def input_of(self, type_name: str) -> str:
        """Return the one input of a message type."""
        return self._port("inputs", self._config.inputs, type_name)

    def output_of(self, type_name: str) -> str:
        """Return the one output of a message type."""
        return self._port("outputs", self._config.outputs, type_name)

    def optional_input_of(self, type_name: str) -> str | None:
        """Return the one input of a message type, or None where the scenario has none."""
        has_one = any(port.type == type_name for port in self._config.inputs.values())
        return self.input_of(type_name) if has_one else None

    def optional_output_of(self, type_name: str) -> str | None:
        """Return the one output of a message type, or None where the scenario has none."""
        has_one = any(port.type == type_name for port in self._config.outputs.values())
        return self.output_of(type_name) if has_one else None

    def input_beside(self, type_name: str, name: str) -> tuple[str, str]:
        """Return the input of a message type, and the other one of that type, which has a name.

        They are the same unless there are two, one of them called `name`.
        """
        names = [port for port, row in self._config.inputs.items() if row.type == type_name]
        if name in names and len(names) == 2:
            return next(port for port in names if port != name), name
        only = self.input_of(type_name)
        return only, only

    def event_outputs(self) -> tuple[str, str]:
        """Return the output of Event/1 for what happens, and that for the summary.

        They are the same unless there are two, one of them called `summary`.
        """
        names = [name for name, port in self._config.outputs.items() if port.type == "Event/1"]
        if "summary" in names and len(names) == 2:
            return next(name for name in names if name != "summary"), "summary"
        only = self.output_of("Event/1")
        return only, only

    def outputs_are(self, *types: str) -> None:
        """Refuse every output that is of none of these message types."""
        for name, port in self._config.outputs.items():
            if port.type not in types:
                text = f"nothing of type {port.type} is published; known: {', '.join(types)}"
                self.problems.add(("outputs", name), text)

    def _port(
        self, side: str, ports: Mapping[str, InputConfig] | Mapping[str, OutputConfig], wanted: str
    ) -> str:
        names = [name for name, port in ports.items() if port.type == wanted]
        if len(names) != 1:
            several = f"{', '.join(names)} are all of type {wanted}; leave one of them"
            none = f"none is of type {wanted}; add one"
            self.problems.add((side,), several if names else none)
        return names[0] if names else ""
