from __future__ import annotations

import re

import pytest
from support.paths import DOCS
from support.runs.scenario import shipped, write

from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.locate import builtin_names
from stepbus_orchestrator.scenario.model import ParticipantRow, ScenarioFile
from stepbus_orchestrator.scenario.resolve import resolved

PAGE = (DOCS / "reference/scenario.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "key", [*ScenarioFile.__struct_encode_fields__, *ParticipantRow.__struct_encode_fields__]
)
def test_the_reference_has_every_key(key):
    assert f"\n| `{key}` |" in PAGE


def test_the_first_example_of_the_reference_is_a_scenario(tmp_path):
    text = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[0]
    text = re.sub(r"participant: stepbus_\w+:\w+", "exec: [python, -c, pass]", text)
    assert load(write(tmp_path, text)).name == "arm"


@pytest.mark.slow
@pytest.mark.parametrize("name", builtin_names())
def test_what_ships_with_stepbus_can_be_run_again_from_its_recording(name, tmp_path):
    scenario = shipped(name)
    for path, file in scenario.files.items():
        write(tmp_path, file.read_text(encoding="utf-8"), path)
    again = load(write(tmp_path, resolved(scenario)))
    assert (again, list(again.files)) == (scenario, list(scenario.files))
