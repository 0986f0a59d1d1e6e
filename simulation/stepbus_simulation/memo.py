"""What costs a run most and is the same in thousands: the scenario as text, and back."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any
from unittest.mock import patch

from stepbus_orchestrator.recording import index
from stepbus_orchestrator.run import run_scenario
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant.parameters import parse_yaml

_parse_yaml = cache(parse_yaml)
_texts: dict[tuple[str, int | None], str] = {}


def _resolved_once(scenario: Scenario) -> str:
    # Knobs are not in it.
    key = scenario.name, scenario.steps
    if key not in _texts:
        _texts[key] = resolved(scenario)
    return _texts[key]


@contextmanager
def memoized() -> Iterator[Any]:
    """Parse and write each scenario once in this process."""
    with (
        patch.object(index, "parse_yaml", _parse_yaml),
        patch.object(run_scenario, "resolved", _resolved_once),
    ):
        yield
