"""`stepbus validate` refuses what the classes of a scenario would refuse at the start of a run."""

import re

import pytest
from support.runs.scenario import write

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.run import rehearse as rehearsal
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

OWN = """\
import numpy as np
from stepbus import JointCommand, JointReference, Participant, SensedJoints, Settings
from stepbus.params import Positive

class Stiff:
    class Params(Settings):
        stiffness: Positive

    def __init__(self, robot, params): pass
    def torque(self, q, v, reference, dt): return np.zeros(len(q))

class NoTorque:
    def __init__(self, robot, params): pass

class Still:
    def __init__(self, joints, params): self.pose = params["pose"]
    def at(self, t): return JointReference(position=self.pose, velocity=[0, 0], acceleration=[0, 0])

class Own(Participant):
    inputs = {"joint_state": SensedJoints, "wanted": JointReference}
    outputs = {"command": JointCommand}
"""
URDF = "model: package://stepbus_scenarios/two_link/two_link.urdf"
LAW = "controller.params={law: own.py:%s, " + URDF + ", stiffness: %s}"


@pytest.fixture
def scenario(tmp_path):
    """Return a scenario in whose folder are classes of the user's."""
    write(tmp_path, OWN, "own.py")
    return write(tmp_path, "extends: two_link/pd\n")


def problems(scenario, *settings):
    """Return path and text of all that `stepbus validate` finds wrong."""
    with pytest.raises(ScenarioError) as caught:
        load(scenario, settings, last_check=rehearsal.rehearse)
    return [
        f"{row.path.removeprefix('participants.')}: {row.message}" for row in caught.value.problems
    ]


@pytest.mark.parametrize(
    ("setting", "found"),
    [
        (LAW % ("Stif", 1), ["controller.params.law: {folder}/own.py has no class 'Stif'"]),
        (LAW % ("Stiff", -1), ["controller.params.stiffness: must be a number above 0, not -1"]),
        (LAW % ("NoTorque", 1), ["controller.params.law: class own.py:NoTorque needs a method 'torque'"]),
        ("mission.params={task: own.py:Still, joints: [joint1, joint2]}", ["mission.params.task: cannot create Still: KeyError: 'pose'"]),
        ("controller.params.kp={joint1: 1, jont2: 2}", [
            "controller.params.kp.jont2: unknown joint 'jont2'; did you mean 'joint2'?",
            "controller.params.kp: joint 'joint2' is missing",
        ]),
        ("controller.outputs.log=Event/1", ["controller.outputs.log: type Event/1 cannot be published here; use JointCommand/1, ControllerStatus/1"]),
    ],
)  # fmt: skip
def test_validate_finds_what_a_run_refuses(scenario, tmp_path, setting, found):
    assert problems(scenario, setting) == [row.format(folder=tmp_path) for row in found]
    reason = run(load(scenario, [setting]), Options(out=tmp_path / "out")).reason
    for row in found:
        assert row.format(folder=tmp_path).partition(": ")[2] in reason


def test_ports_that_a_class_of_the_users_does_not_have_are_found(scenario):
    own = ("controller.participant=own.py:Own", "controller.params=null")
    found = [
        re.split(": the program has |, the scenario ", row) for row in problems(scenario, *own)
    ]
    assert found == [
        ["controller.inputs.reference", "no such port", "JointReference/1"],
        ["controller.inputs.wanted", "JointReference/1", "no such port"],
        ["controller.outputs.status", "no such port", "ControllerStatus/1"],
    ]


def test_the_problems_of_all_participants_are_found_at_once(scenario):
    settings = (LAW % ("NoTorque", 1), "plant.params.joints=[join1]")
    law, joints = problems(scenario, *settings)
    assert law.startswith("controller.params.law: ")
    assert joints.endswith("did you mean 'joint1'?")


@pytest.mark.parametrize("law", ["own.py:Stiff", "own:Stiff", "below/own.py:Stiff"])
def test_a_law_of_a_file_or_module_is_valid_and_its_file_recorded(scenario, tmp_path, law):
    write(tmp_path, OWN, "below/own.py")
    setting = (LAW % ("Stiff", 1)).replace("own.py:Stiff", law)
    checked = load(scenario, [setting], last_check=rehearsal.rehearse)
    assert ("below/own.py" if "below" in law else "own.py") in checked.files


def test_a_law_of_a_scenario_in_another_folder_is_found(scenario, tmp_path):
    write(tmp_path, OWN, "laws/own.py")
    write(
        tmp_path,
        "extends: two_link/pd\nparticipants: {controller: {params: {law: laws/own.py:Stiff}}}\n",
        "base.yaml",
    )
    more = "participants: {controller: {params: {kp: null, kd: null, stiffness: 1}}}\n"
    path = write(tmp_path, f"extends: ../base.yaml\n{more}", "sub/scenario.yaml")
    checked = load(path, last_check=rehearsal.rehearse)
    assert checked.participant("controller").params["law"] == "../laws/own.py:Stiff"


def test_a_class_that_crashes_is_a_sentence(scenario, tmp_path, capsys):
    write(
        tmp_path,
        "import os\nclass Law:\n    def __init__(self, *_): os.abort()\n    def torque(self, *_): pass\n",
        "own.py",
    )
    assert cli.main(["validate", str(scenario), "--set", LAW % ("Law", 1)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "Controller cannot be checked" in said
    assert "-6" in said


@pytest.mark.slow
def test_a_class_that_never_returns_is_a_sentence(scenario, tmp_path, monkeypatch):
    monkeypatch.setattr(rehearsal, "_LONGEST_S", 3.0)
    write(
        tmp_path,
        "import time\nclass Law:\n    def __init__(self, *_): time.sleep(600)\n    def torque(self, *_): pass\n",
        "own.py",
    )
    text = "controller.participant: stepbus_controller:Controller is not ready after 3 s"
    assert text in problems(scenario, LAW % ("Law", 1))


def test_a_class_of_the_users_is_not_made_since_it_may_move_a_motor(scenario, tmp_path):
    made = tmp_path / "made"
    init = f"    def __init__(self, config): open({str(made)!r}, 'w').close()\n"
    write(tmp_path, f"from stepbus import Participant\nclass Own(Participant):\n{init}", "own.py")
    own = ("controller.participant=own.py:Own", "controller.params=null")
    load(scenario, own, last_check=rehearsal.rehearse)
    assert not made.exists()
