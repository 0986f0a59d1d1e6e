"""From a path, a name or plain data to a checked scenario."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.build import build
from stepbus_orchestrator.scenario.check import check
from stepbus_orchestrator.scenario.extend import read_extended
from stepbus_orchestrator.scenario.fault_texts import add_faults
from stepbus_orchestrator.scenario.locate import locate
from stepbus_orchestrator.scenario.override import changed_value, named_from, override
from stepbus_orchestrator.scenario.scenario_files import find_files
from stepbus_participant import Problems, SettingsError
from stepbus_participant.parameters import YamlFile

from .model import Scenario


def load(
    scenario: str | Path | Mapping[str, Any],
    overrides: Sequence[str] = (),
    faults: Sequence[str] = (),
    *,
    folder: Path | None = None,
    last_check: Callable[[Scenario, Problems], None] | None = None,
) -> Scenario:
    """Load and check a scenario; nothing is started.

    scenario: a YAML file, a folder with a scenario.yaml, the name of a built-in scenario, or plain
    data, as YAML would have it. overrides: settings such as `controller.params.kp=80` or
    `duration=2s`; files in them are absolute, or relative to the scenario's folder. faults: more
    of them, such as `kill plant at 120`. folder: what relative file names in plain data are
    relative to; default: the current one. last_check: comes after all others, where these find
    nothing.

    Raises ScenarioError that lists every problem with file, line and path.
    """
    try:
        if isinstance(scenario, Mapping):
            path = (folder or Path.cwd()).absolute() / "scenario"
            document = YamlFile(file="scenario", data=dict(scenario), places={})
        else:
            path = locate(scenario)
            document = read_extended(path)
        overrides = [changed_value(text, partial(named_from, path.parent)) for text in overrides]
        document = override(document, overrides)
        if faults:
            document = add_faults(document, faults)
        problems = document.problems()
        checked = build(document.data, path, problems)
        check(checked, problems)
        files = find_files(checked)
        for keys, message in files.problems:
            problems.add(keys, message)
        problems.refuse()
        if last_check is not None:
            last_check(checked, problems)
            problems.refuse()
    except SettingsError as exc:
        raise ScenarioError(exc.problems) from exc
    return dataclasses.replace(
        checked, overrides=tuple(overrides), files=files.paths, left_out=files.left_out
    )
