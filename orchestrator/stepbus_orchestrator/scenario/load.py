"""From a path or a name to a checked scenario."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.build import build
from stepbus_orchestrator.scenario.check import check
from stepbus_orchestrator.scenario.earlier import upgraded
from stepbus_orchestrator.scenario.extend import read_extended
from stepbus_orchestrator.scenario.locate import locate
from stepbus_orchestrator.scenario.override import add_faults, override
from stepbus_orchestrator.scenario.scenario_files import find_files
from stepbus_orchestrator.scenario.template import instantiate
from stepbus_participant import Problems, SettingsError
from stepbus_participant.parameters import YamlFile

from .model import Scenario


def load(
    path_or_name: str | Path,
    overrides: Sequence[str] = (),
    faults: Sequence[str] = (),
    last_check: Callable[[Scenario, Problems], None] | None = None,
) -> Scenario:
    """Load and check a scenario; nothing is started.

    path_or_name: a YAML file, a folder with a scenario.yaml, or the name of a built-in scenario.
    overrides: settings such as `controller.params.kp=80` or `duration=2s`. faults: more of them,
    such as `kill plant at 120`. last_check: comes after all others, where these find nothing.

    Raises ScenarioError that lists every problem with file, line and path.
    """
    try:
        path = locate(path_or_name)
        return _checked(read_extended(path), path, overrides, faults, last_check)
    except SettingsError as exc:
        raise ScenarioError(exc.problems) from exc


def check_data(
    data: Mapping[str, Any],
    folder: Path,
    overrides: Sequence[str] = (),
    faults: Sequence[str] = (),
) -> Scenario:
    """Check a scenario that is plain data, as YAML would have it; nothing is started.

    folder: what relative file names are relative to. overrides, faults: as of `load`.

    Raises ScenarioError that lists every problem with its path.
    """
    try:
        file = instantiate(YamlFile(file="scenario", data=dict(data), places={}))
        return _checked(file, folder.absolute() / "scenario", overrides, faults)
    except SettingsError as exc:
        raise ScenarioError(exc.problems) from exc


def _checked(
    file: YamlFile,
    path: Path,
    overrides: Sequence[str],
    faults: Sequence[str],
    last_check: Callable[[Scenario, Problems], None] | None = None,
) -> Scenario:
    file = add_faults(override(file, overrides), faults)
    problems = file.problems()
    scenario = build(upgraded(file.data), path, problems)
    check(scenario, problems)
    found = find_files(scenario)
    for keys, message in found.problems:
        problems.add(keys, message)
    problems.refuse()
    if last_check is not None:
        last_check(scenario, problems)
        problems.refuse()
    return dataclasses.replace(
        scenario, overrides=tuple(overrides), files=found.paths, left_out=found.left_out
    )
