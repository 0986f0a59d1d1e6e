"""What a participant learns when it joins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from stepbus_participant.files import find_file
from stepbus_participant.parameters.problems import Problems
from stepbus_participant.parameters.read import read
from stepbus_participant.parameters.settings import Settings
from stepbus_schemas import SHIPPED, InputConfig, OutputConfig, Types, Welcome, WiringError

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
        found = read(settings, self.params, problems.below(("params",)), folder=self.folder)
        problems.refuse()
        return found

    def problems(self) -> Problems:
        """Return an empty collector of problems, for keys of this participant."""
        return Problems(above=("participants", self.name))
