"""What a participant learns when it joins."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepbus_schemas import InputConfig, OutputConfig, Welcome, WiringError

_EXTRAS = {"example-robot-data": "robots"}
"""Package of models → the extra of stepbus that installs it."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """The part of the scenario that concerns one participant.

    name: its name. params: its `params`, as written in the scenario. step_ns: length of a step
    [ns]. every: it fires at multiples of this [steps]. seed: seed of its own, derived from the
    run's seed and its name. folder: what relative file names are relative to. publishes: `first`
    or `last`, before or after it reads its inputs.
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

    @classmethod
    def from_welcome(cls, welcome: Welcome) -> Config:
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
        path = package_path(name) if name.startswith("package://") else self.folder / name
        if not path.exists():
            raise WiringError(f"participants.{self.name}.params: no file {name!r} ({path})")
        return path


def package_path(url: str) -> Path:
    """Return the file behind `package://<package>/<path>`.

    Raises WiringError when the package is not installed.
    """
    package, _, rest = url.removeprefix("package://").partition("/")
    spec = importlib.util.find_spec(package) if package.isidentifier() else None
    if spec is not None and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))) / rest
    cmeel = importlib.util.find_spec("cmeel")
    if cmeel is not None and cmeel.origin is not None:
        share = Path(cmeel.origin).parent.parent / "cmeel.prefix" / "share"
        if (share / package).is_dir():
            return share / package / rest
    extra = _EXTRAS.get(package)
    install = f"; pip install 'stepbus[{extra}]'" if extra else ""
    raise WiringError(f"{url}: package {package!r} is not installed here{install}")
