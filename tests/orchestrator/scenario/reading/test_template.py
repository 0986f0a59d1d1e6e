"""`templates`: participants that differ in a few values are written once."""

import pytest
from support.runs.scenario import changed, load_text, problems_of, write

from stepbus_orchestrator.scenario.load import load

CONTROLLER = """\
  controller:
    exec: [python, -c, pass]
    inputs: {joint_state: plant.joint_state, reference: mission.reference}
    outputs: {command: JointCommand/1, status: ControllerStatus/1}
    params: {law: pd, kp: 100}
"""
TEMPLATE = """\
templates:
  arm:
    exec: [python, -c, pass]
    inputs: {joint_state: plant.joint_state, reference: mission.reference}
    outputs: {command: JointCommand/1}
    params: {prefix: "${side}/", kp: "${kp}", "${side}_gain": 1}
"""
PAIR = """\
  controller: {template: arm, with: {side: left, kp: 100}}
  other: {template: arm, with: {side: right, kp: 5}, every: 2, params: {kd: 1, kp: null}}
"""


def text(pair=PAIR):
    return changed(CONTROLLER, pair) + TEMPLATE


def test_each_participant_has_the_keys_of_its_template_with_its_own_values(tmp_path):
    scenario = load_text(tmp_path, text())
    one, other = (scenario.participant(name) for name in ("controller", "other"))
    assert one.params == {"prefix": "left/", "kp": 100, "left_gain": 1}
    assert other.params == {"prefix": "right/", "right_gain": 1, "kd": 1}
    assert (one.every, other.every, other.exec) == (1, 2, ("python", "-c", "pass"))


def test_what_is_set_from_the_command_line_is_of_the_participant(tmp_path):
    scenario = load_text(tmp_path, text(), "other.params.prefix=x/")
    assert scenario.participant("other").params["prefix"] == "x/"


def test_a_scenario_on_top_changes_a_parameter(tmp_path):
    write(tmp_path, text())
    top = "extends: scenario.yaml\nparticipants: {controller: {with: {kp: 7}}}\n"
    scenario = load(write(tmp_path, top, "top.yaml"))
    assert scenario.participant("controller").params["kp"] == 7


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("{template: amr}", "controller.template: no template 'amr'; did you mean 'arm'?"),
        ("{with: {a: 1}}", "controller.with: needs a 'template'"),
        ("{template: [arm]}", "controller.template: must name a template, not a list"),
        (
            "{template: arm, with: {side: a}}",
            "controller.with: lacks 'kp', a parameter of template 'arm'",
        ),
        (
            "{template: arm, with: {side: a, kp: 1, kpp: 1}}",
            "controller.with.kpp: template 'arm' has no parameter 'kpp'; did you mean 'kp'?",
        ),
        ("{template: arm, with: 3}", "controller.with: must be a map of parameters, not 3"),
    ],
)
def test_a_mistake_is_named_with_its_place(tmp_path, row, problem):
    lines = problems_of(tmp_path, text(f"  controller: {row}\n"))
    assert f"scenario.yaml:10: participants.{problem}" in lines


def test_a_mistake_in_the_template_has_its_line(tmp_path):
    lines = problems_of(tmp_path, text().replace("    exec: [python, -c, pass]\n    inputs: {joint"
        "_state: plant.joint_state, reference: mission.reference}\n    outputs: {command: JointC"
        "ommand/1}\n", "    exec: [nowhere]\n"))  # fmt: skip
    assert any(line.startswith("scenario.yaml:19: participants.controller.exec:") for line in lines)
