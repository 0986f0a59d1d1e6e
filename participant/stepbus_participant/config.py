"""The configuration of one participant: its parameters and ports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from stepbus_schemas import SHIPPED, InputConfig, OutputConfig, Types, Welcome, WiringError

from .files import find_file
from .parameters.problems import Problems
from .parameters.read import read
from .parameters.settings import Settings

_S = TypeVar("_S", bound=Settings)


@dataclass(frozen=True, kw_only=True)
class Config:
    """The configuration of one participant, from the scenario.

    name: its name. params: its `params`, as written in the scenario. step_ns: length of a step
    [ns]. every: it fires at multiples of this [steps]. seed: the participant's seed, derived from
    the run's seed and its name. folder: base of relative file names. publishes: `first` or `last`,
    before or after it reads its inputs. types: message types by name, such as
    `config.types["Thruster/1"]`, including those of the scenario.
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
        """Return one parameter, or `default` if the scenario does not set it."""
        return self.params.get(name, default)

    def path(self, name: str) -> Path:
        """Return the path of a file.

        name: the value of a parameter, `config.path(config.params["model"])`: absolute, relative to
        the scenario's folder, or `package://<package>/<path>`, where the package is an installed
        Python package or a folder of `cmeel.prefix/share`.
        Raises WiringError if the file does not exist.
        """
        try:
            return find_file(name, self.folder)
        except WiringError as exc:
            hint = ""
            if name in self.params:
                hint = f"; for the value of that parameter, write config.params[{name!r}]"
            raise WiringError(f"participants.{self.name}.params: {exc}{hint}") from exc

    def read(self, settings: type[_S], problems: Problems | None = None) -> _S:
        """Return `params` as an instance of the settings class that declares them.

        problems: further problems, for example with ports. Raises SettingsError that lists them
        and every problem with the params.
        """
        problems = self.problems() if problems is None else problems
        params = read(settings, self.params, problems.below(("params",)), folder=self.folder)
        problems.refuse()
        return params

    def problems(self) -> Problems:
        """Return an empty collector of problems, for keys of this participant."""
        return Problems(above=("participants", self.name))


class Ports:
    """Finds ports by message type, for participants whose ports can have any name.

    problems: collects missing and ambiguous ports; their names are then empty. Pass them to
    `Config.read`, which raises an error that lists them all.
    """

    def __init__(self, config: Config) -> None:
        self.problems = config.problems()
        self._inputs = {name: port.type for name, port in config.inputs.items()}
        self._outputs = {name: port.type for name, port in config.outputs.items()}

    def input_of(self, type_name: str) -> str:
        """Return the one input of a message type."""
        return self._only("inputs", self._inputs, type_name)

    def output_of(self, type_name: str) -> str:
        """Return the one output of a message type."""
        return self._only("outputs", self._outputs, type_name)

    def optional_input_of(self, type_name: str) -> str | None:
        """Return the one input of a message type, or None if there is none."""
        return self.input_of(type_name) if type_name in self._inputs.values() else None

    def optional_output_of(self, type_name: str) -> str | None:
        """Return the one output of a message type, or None if there is none."""
        return self.output_of(type_name) if type_name in self._outputs.values() else None

    def input_beside(self, type_name: str, name: str) -> tuple[str, str]:
        """Return the inputs of a message type: the main one, and the one with a given name.

        They are the same unless there are two, one of them called `name`.
        """
        return _pair(self._inputs, type_name, name) or (self.input_of(type_name),) * 2

    def event_outputs(self) -> tuple[str, str]:
        """Return the outputs of type Event/1: for events, and for the summary.

        They are the same unless there are two, one of them called `summary`.
        """
        pair = _pair(self._outputs, "Event/1", "summary")
        return pair or (self.output_of("Event/1"),) * 2

    def outputs_are(self, *types: str) -> None:
        """Report every output whose type is not one of these."""
        for name, type_name in self._outputs.items():
            if type_name not in types:
                text = f"type {type_name} cannot be published here; use {', '.join(types)}"
                self.problems.add(("outputs", name), text)

    def _only(self, side: str, ports: Mapping[str, str], wanted: str) -> str:
        names = _names(ports, wanted)
        if len(names) != 1:
            several = f"{', '.join(names)} all have type {wanted}; keep only one"
            none = f"no port has type {wanted}; add one"
            self.problems.add((side,), several if names else none)
        return names[0] if names else ""


def _names(ports: Mapping[str, str], wanted: str) -> list[str]:
    return [name for name, type_name in ports.items() if type_name == wanted]


def _pair(ports: Mapping[str, str], wanted: str, name: str) -> tuple[str, str] | None:
    """Return two ports of a type, the one that is called `name` last; None for any other."""
    names = sorted(_names(ports, wanted), key=lambda port: port == name)
    return (names[0], name) if len(names) == 2 and names[1] == name else None
