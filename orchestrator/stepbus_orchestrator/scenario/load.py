"""From a path or a name to a checked scenario.

SettingsError
└─ ScenarioError      lists every problem of a scenario, one a line
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stepbus_participant import SettingsError

from .check import check
from .model import Scenario
from .reading.build import build
from .reading.extend import read_extended
from .reading.locate import locate
from .reading.override import add_faults, override


class ScenarioError(SettingsError):
    """A scenario cannot be run; `problems` has every reason, its text one a line."""


def load(
    path_or_name: str | Path, overrides: Sequence[str] = (), faults: Sequence[str] = ()
) -> Scenario:
    """Load and check a scenario; nothing is started.

    path_or_name: a YAML file, a folder with a scenario.yaml, or the name of a built-in scenario.
    overrides: settings such as `controller.params.kp=80` or `duration=2s`. faults: more of them,
    such as `kill plant at 120`.

    Raises ScenarioError that lists every problem with file, line and path.
    """
    try:
        path = locate(path_or_name)
        file = add_faults(override(read_extended(path), overrides), faults)
        problems = file.problems()
        scenario = build(file.data, path, problems)
        check(scenario, problems)
        problems.refuse()
    except SettingsError as exc:
        raise ScenarioError(exc.problems) from exc
    return scenario
