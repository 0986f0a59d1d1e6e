"""The mistakes that joint angles invite: each gives its sentence wherever one looks for it."""

import json
from importlib import resources

import numpy as np
import pytest

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.signals import read_tracking

SCENARIO = """
name: mistakes
step: 20ms
duration: 200ms
participants:
  plant:
    participant: stepbus_plant:Plant
    publishes: first
    inputs: {command: controller.command}
    outputs: {joint_state: JointState/1, events: Event/1}
    params: {world: world.yaml, joints: [joint1, joint2]}
  controller:
    participant: stepbus_controller.position:PositionController
    inputs: {joint_state: plant.joint_state, reference: mission.reference}
    outputs: {command: JointCommand/1}
    params: {joints: [joint1, joint2]}
  mission:
    participant: stepbus_mission:Mission
    outputs: {reference: JointReference/1}
    params:
      task: sine
      joints: [joint1, joint2]
      amplitude: 0.1
      offset: {joint1: -0.5, joint2: 1.0}
"""
WORLD = """
bodies:
  arm:
    urdf: arm.urdf
    fixed_base: true
    joint_defaults: {mode: position}
    joints:
      joint1: {position: -0.5, MORE}
      joint2: {position: 1.0}
"""


def scenario(folder, more="", urdf=None):
    """Write two joints that follow a sinusoid; more: settings of joint1; return the folder."""
    folder.mkdir(exist_ok=True)
    two_link = resources.files("stepbus_scenarios") / "two_link" / "two_link.urdf"
    (folder / "arm.urdf").write_text(urdf or two_link.read_text(encoding="utf-8"))
    (folder / "world.yaml").write_text(WORLD.replace("MORE", more))
    (folder / "scenario.yaml").write_text(SCENARIO)
    return folder


@pytest.mark.parametrize(
    ("change", "more", "sentence"),
    [
        ("seed=0", "motor: false", "has no motor (world file: motor: false)"),
        ("plant.params.effort.joint1=0", "", "has an effort limit of 0 N·m"),
        ("seed=0", "upper: -0.5, lower: -1", "rad is beyond its stop at -0.5"),
        ("mission.params.offset.joint1=-30", "", "is beyond its stop at -6.2832"),
    ],
    ids=["no motor", "no effort", "beyond a stop", "degrees"],
)
def test_a_mistake_is_shown_summed_up_and_recorded(tmp_path, capsys, change, more, sentence):
    out = tmp_path / "run"
    folder = str(scenario(tmp_path / "source", more))
    words = ["run", folder, "--in-process", "--no-report", "--out", str(out), "--set", change]
    assert main(words) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert shown.count(sentence) == 2
    result = json.loads((out / "result.json").read_text())
    assert any(sentence in warned["text"] for warned in result["warnings"])
    events = [event for _, event in Recording(out / "run.mcap").messages("plant/events")]
    assert any(sentence in event.text for event in events)


def test_the_scenario_without_mistakes_has_no_warning(tmp_path):
    result = run(
        load(scenario(tmp_path / "source")), Options(out=tmp_path / "run", host=InProcess())
    )
    assert (result.exit_code, result.warning_count) == (0, 0)


def test_a_joint_that_is_fixed_in_the_model_is_named_before_the_first_step(tmp_path, capsys):
    source = scenario(tmp_path / "source")
    text = (source / "arm.urdf").read_text()
    at = text.index('type="revolute"', text.index("joint2"))
    fixed = text[:at] + 'type="fixed"' + text[at + len('type="revolute"') :]
    world = (source / "world.yaml").read_text().replace("      joint2: {position: 1.0}\n", "")
    (source / "arm.urdf").write_text(fixed)
    (source / "world.yaml").write_text(world)
    words = ["run", str(source), "--in-process", "--no-report", "--out", str(tmp_path / "run")]
    assert main(words) != 0
    assert "'joint2' is fixed in its model" in capsys.readouterr().err


BRANCH = """<link name="{n}"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{n}" type="revolute"><parent link="base"/><child link="{n}"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="5"/></joint>"""


def test_the_order_of_the_joints_in_the_model_changes_nothing(tmp_path):
    states = []
    for names in (("joint1", "joint2"), ("joint2", "joint1")):
        branches = "".join(BRANCH.format(n=name) for name in names)
        urdf = f'<robot name="arm"><link name="base"/>{branches}</robot>'
        source = scenario(tmp_path / names[0], urdf=urdf)
        changes = [f"plant.params.joints=[{', '.join(names)}]"]
        out = tmp_path / f"run_{names[0]}"
        result = run(load(source, changes), Options(out=out, host=InProcess()))
        states.append(read_tracking(Recording(result.recording)).state_of("joint1"))
    assert [state.names for state in states] == [["joint1", "joint2"], ["joint2", "joint1"]]
    for name in ("joint1", "joint2"):
        first, second = (state.of("position", name) for state in states)
        assert np.ptp(first) > 0.01
        assert np.abs(first - second).max() < 1e-12
