"""Tables and JSON Schemas that come from declared parameters."""

from __future__ import annotations

import json

import jsonschema
import pytest
from ruamel.yaml import YAML
from scripts.generate_parameters import generated_files, main
from support.paths import CHECKOUT
from support.runs.scenario import shipped

from stepbus_orchestrator.scenario.locate import builtin_names

COMMENT = "# yaml-language-server: $schema="
SCENARIO = """\
participants:
  plant: {{participant: stepbus_plant:Plant, params: {params}}}
"""


SCHEMA = CHECKOUT / "schemas/json/scenario.schema.json"
WORLD = CHECKOUT / "schemas/json/world.schema.json"


def schema(path):
    return jsonschema.Draft202012Validator(json.loads(path.read_text(encoding="utf-8")))


def found_in(validator, text):
    return [
        error.message for error in validator.iter_errors(YAML(typ="safe", pure=True).load(text))
    ]


def test_generated_files_are_up_to_date(capsys):
    assert main(["--check"]) == 0, capsys.readouterr().out


def test_a_stale_page_is_named(tmp_path):
    page = tmp_path / "docs/page.md"
    page.parent.mkdir()
    page.write_text(
        "<!-- parameters: stepbus_mission.params:Params -->\nold\n<!-- /parameters -->\n"
    )
    text = generated_files(tmp_path)[page]
    assert (
        "| `duration` | number > 0 | none | Time since the previous waypoint, instead of `time` [s]. |"
        in text
    )
    assert "old" not in text


@pytest.mark.parametrize("name", builtin_names())
def test_every_shipped_scenario_names_the_schema_and_keeps_to_it(name):
    scenario = shipped(name)
    text = scenario.file.read_text(encoding="utf-8")
    first = text.partition("\n")[0]
    assert first.startswith(COMMENT)
    named = (scenario.folder / first.removeprefix(COMMENT)).resolve()
    assert found_in(schema(named), text) == []


@pytest.mark.parametrize("name", sorted({name.partition("/")[0] for name in builtin_names()}))
def test_every_shipped_world_keeps_to_the_schema(name):
    world = shipped(name).folder / "world.yaml"
    assert found_in(schema(WORLD), world.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ("{wrld: x}", "'wrld' was unexpected"),
        ("{noise: {position: -1}}", "-1 is less than the minimum of 0"),
        ("{actuation: magic}", "'magic' is not one of"),
        ("{cameras: 3}", "3 is not of type 'boolean', 'null'"),
    ],
)
def test_the_schema_of_a_scenario_knows_the_parameters_of_a_service(params, message):
    (found,) = found_in(schema(SCHEMA), SCENARIO.format(params=params))
    assert message in found
