"""The key `bridge` of a scenario: read, checked, resolved, and made into a command."""

import subprocess
import sys

import pytest
from support.runs.scenario import changed, load_text, problem_of

from stepbus_orchestrator.scenario.model import BridgeSpec
from stepbus_orchestrator.scenario.program import command
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_schemas import WiringError

OWN = "exec: [python, -c, pass]\n    inputs: {joint_state: plant.joint_state, reference"
BRIDGED = changed(OWN, OWN.replace("pass]", "pass]\n    bridge: json"))
LONG = "{format: json, describe: {command: {like: reference}}}"


def test_one_word_is_all_a_user_writes(tmp_path):
    spec = load_text(tmp_path, BRIDGED).participant("controller")
    assert spec.bridge == BridgeSpec(format="json")
    words = (sys.executable, "-P", "-m", "stepbus_bridge", "--format", "json", "--")
    assert command(spec.program, tmp_path) == (*words, sys.executable, "-c", "pass")


def test_the_long_form_describes_the_outputs(tmp_path):
    spec = load_text(tmp_path, BRIDGED, f"controller.bridge={LONG}").participant("controller")
    assert spec.bridge == BridgeSpec(format="json", describe={"command": {"like": "reference"}})
    assert '{"command": {"like": "reference"}}' in command(spec.program, tmp_path)


@pytest.mark.parametrize("value", ["msgpack", LONG])
def test_the_resolved_scenario_says_it_too(tmp_path, value):
    scenario = load_text(tmp_path, BRIDGED, f"controller.bridge={value}")
    assert load_text(tmp_path / "again", resolved(scenario)) == scenario


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ("yaml", "bridge: must be json, msgpack or raw, not 'yaml'"),
        ("[json]", "bridge: must be text or a map, not a list"),
        ("{format: json, describe: {command: 3}}", "bridge.describe.command: must be a map, not 3"),
        ("{describe: {}}", "bridge: the key 'format' is missing"),
        ("{format: json, describe: {komand: {}}}", "no output 'komand'; did you mean 'command'?"),
        (
            "{format: json, describe: {command: {name: [a]}}}",
            "Description has no field 'name'; did you mean 'names'?",
        ),
        ("{format: json, describe: {command: {names: a}}}", "names: Expected `array`, got `str`"),
        ("raw", "format raw carries only types made of numbers, not status"),
    ],
)
def test_what_cannot_be_bridged_is_refused(tmp_path, value, sentence):
    assert sentence in problem_of(tmp_path, BRIDGED, f"controller.bridge={value}")


def test_a_program_that_publishes_first_cannot_be_bridged_raw(tmp_path):
    assert "raw cannot publish first" in problem_of(tmp_path, BRIDGED, "plant.bridge=raw")


def test_what_a_script_in_javascript_imports_is_attached(tmp_path):
    (tmp_path / "law.mjs").write_text("export const kp = 1;\n")
    (tmp_path / "main.mjs").write_text('import { kp } from "./law.mjs";\n')
    exec_ = "controller.exec=[python, main.mjs]"
    assert list(load_text(tmp_path, BRIDGED, exec_).files) == ["law.mjs", "main.mjs"]


def test_the_bridge_by_hand_does_not_load_the_other_commands(tmp_path):
    words = command(("stepbus", "bridge", "--", "python", "x.py"), tmp_path)
    assert words == (sys.executable, "-P", "-m", "stepbus_bridge", "--", sys.executable, "x.py")


def test_a_program_behind_the_bridge_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(WiringError, match="no program 'nodde' on PATH, nor in"):
        command(("stepbus", "bridge", "--", "nodde", "x.mjs"), tmp_path)


def test_a_bridge_without_a_ticket_says_so():
    words = [sys.executable, "-m", "stepbus_orchestrator.cli", "bridge", "--", "python", "x.py"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "STEPBUS_TICKET is not set" in done.stderr
