"""From a path or a name to a checked scenario."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .build import build
from .check import check
from .extend import read_extended
from .fields import Field
from .locate import locate
from .model import Scenario
from .override import add_faults, override
from .problems import Problems


def load(
    path_or_name: str | Path, overrides: Sequence[str] = (), faults: Sequence[str] = ()
) -> Scenario:
    """Load and check a scenario; nothing is started.

    path_or_name: a YAML file, a folder with a scenario.yaml, or the name of a built-in scenario.
    overrides: settings such as `controller.params.kp=80` or `duration=2s`. faults: more of them,
    such as `kill plant at 120`.

    Raises ScenarioError that lists every problem with file, line and path.
    """
    path = locate(path_or_name)
    document = add_faults(override(read_extended(path), overrides), faults)
    problems = Problems(document.file, document.places, document.problems)
    scenario = build(Field(document.data, (), problems), path)
    check(scenario, problems)
    problems.refuse()
    return scenario
