"""What only loading a world shows is said by `stepbus validate`, with file, line and nearest name."""

import json
import re

import pytest

from stepbus_orchestrator import cli
from stepbus_orchestrator.cli.new import write_starter
from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import Config, SettingsError
from stepbus_plant import Plant

SENSORS = """\
imus:
  torso: {link: link2}
cameras:
  eye: {link: link2, period: 10ms}
"""
STATE = "outputs: {joint_state: JointState/1"
WORLD = "params: {world: world.yaml"


@pytest.fixture
def arm(tmp_path):
    """Return a function that writes a scenario with changes in world and scenario; its folder."""

    def make(world=None, scenario=None):
        folder = tmp_path / "arm"
        write_starter(folder, "python")
        for name, changes, more in (
            ("world.yaml", world, SENSORS),
            ("scenario.yaml", scenario, ""),
        ):
            text = (folder / name).read_text() + more
            for old, new in (changes or {}).items():
                assert old in text
                text = text.replace(old, new, 1)
            (folder / name).write_text(text)
        return folder

    return make


def found(folder):
    """Return the path below the participant, or that of the world, and the text of each problem."""
    scenario = load(folder)
    welcome = welcome_of(scenario, scenario.participant("plant"), "")
    try:
        Plant(Config.from_welcome(welcome)).close()
    except SettingsError as exc:
        return [
            ("params.world", str(row).replace(str(folder), ""))
            if row.place.file
            else (".".join(map(str, row.keys[2:])), row.message)
            for row in exc.problems
        ]
    return []


def test_a_world_that_is_right_has_no_problems(arm):
    assert found(arm(scenario={STATE: f"{STATE}, torso: Imu/1, rgb: Image/1"})) == []


IN_THE_WORLD = [
    ({"link: link2}": "link: lnk2}"}, "12: imus.torso.link: link 'lnk2' is unknown; did you mean 'link2'?"),
    ({"link: link2}": "link: link2, period: 7ms}"}, "12: imus.torso.period: 7ms is not a multiple of the plant's step (5ms)"),
    ({"period: 10ms": "period: 12ms"}, "14: cameras.eye.period: 12ms is not a multiple of the plant's step (5ms)"),
    ({"physics_step: 5ms": "physics_step: 2ms"}, "3: physics_step: 2ms does not divide the plant's step of 5ms"),
    ({"physics_step: 5ms": "substeps: 3"}, "3: substeps: 3 substeps do not divide the plant's step of 5ms into whole nanoseconds"),
    ({"joint2: {pos": "jont2: {pos"}, "10: bodies.arm.joints.jont2: unknown joint 'jont2'; did you mean 'joint2'?"),
    ({"position: 1.0": "position: 100.0"}, "10: bodies.arm.joints.joint2: joint joint2: start position 100.0 is outside its limits [-6.2832, 6.2832]"),
    ({"imus:": "bases: {cart: {left: jont1, right: joint2, wheel_radius: 1, track: 1}}\nimus:"}, "11: bases.cart.left: joint 'jont1' is unknown; did you mean 'joint1'?"),
    ({"imus:": "contacts: {skin: {links: [lnk1]}}\nimus:"}, "11: contacts.skin.links[0]: link 'lnk1' is unknown; did you mean 'link1'?"),
    ({"imus:": "wrenches: {ft: {joint: jont1}}\nimus:"}, "11: wrenches.ft.joint: joint 'jont1' is unknown; did you mean 'joint1'?"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "sentence"), IN_THE_WORLD)
def test_a_mistake_in_the_world_has_its_line(arm, change, sentence):
    assert ("params.world", f"/world.yaml:{sentence}") in found(arm(world=change))


IN_THE_SCENARIO = [
    ({STATE: f"{STATE}, ft: Wrench/1"}, "outputs.ft", "has type Wrench/1, but the world has no 'wrenches'"),
    ({STATE: f"{STATE}, odo: BaseState/1"}, "outputs.odo", "has type BaseState/1, but the world has no 'bases'"),
    ({STATE: f"{STATE}, color: Image/1"}, "outputs.color", "has type Image/1; name it one of rgb, eye_rgb, depth, eye_depth"),
    ({"{command: controller.command}": "{command: controller.command, arm: {from: mission.reference, type: JointReference/1}}"}, "inputs.arm", "inputs of a plant have type JointCommand/1 or BaseCommand/1 or GripperCommand/1 or CameraTrigger/1 or Wrench/1, not JointReference/1"),
    ({WORLD: f"{WORLD}, physics_step: 3ms"}, "params.physics_step", "3ms does not divide the plant's step of 5ms"),
    ({WORLD: f"{WORLD}, joints: [join1]"}, "params.joints", "'join1' is unknown; did you mean 'joint1'?"),
    ({WORLD: f"{WORLD}, effort: {{jont1: 1}}"}, "params.effort", "joint 'jont1' is unknown; did you mean 'joint1'?"),
    ({WORLD: f"{WORLD}, poses: [lnk1]"}, "params.poses", "link 'lnk1' is unknown; did you mean 'link1'?"),
    ({WORLD: f"{WORLD}, poses_period: 7ms"}, "params.poses_period", "7ms is not a multiple of the plant's step (5ms)"),
    ({WORLD: f"{WORLD}, script: [{{at: 1s, body: am, position: [0, 0, 0]}}]"}, "params.script.0.body", "body 'am' is unknown; did you mean 'arm'?"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "path", "sentence"), IN_THE_SCENARIO)
def test_a_mistake_in_the_scenario_stands_at_its_key(arm, change, path, sentence):
    assert (path, sentence) in found(arm(scenario=change))


def test_validate_lists_all_of_them_at_once(arm, capsys):
    world = {"link: link2}": "link: lnk2, period: 7ms}", "physics_step: 5ms": "physics_step: 2ms"}
    folder = arm(world=world, scenario={WORLD: f"{WORLD}, joints: [join1]"})
    assert cli.main(["validate", str(folder)]) == 2
    params = "scenario.yaml:12: participants.plant.params"
    where = f"{params}.world: {folder}/world.yaml"
    rows = capsys.readouterr().err.removeprefix("stepbus: ").splitlines()
    starts = [
        f"{params}.joints: ",
        f"{where}:3: physics_step: ",
        f"{where}:12: imus.torso.link: ",
        f"{where}:12: imus.torso.period: ",
    ]
    assert [row.startswith(start) for row, start in zip(rows, starts, strict=True)] == [True] * 4


def test_validate_and_the_run_show_what_is_repaired(arm, tmp_path, capsys):
    folder = arm()
    urdf = next(folder.glob("*.urdf"))
    inertia = '<inertia ixx="1" iyy="1" izz="3" ixy="0" ixz="0" iyz="0"/>'
    urdf.write_text(re.sub("<inertia .*?/>", inertia, urdf.read_text(), count=1))
    warning = "no body can have the inertia (1, 1, 3)"
    assert cli.main(["validate", str(folder / "scenario.yaml")]) == 0
    assert warning in capsys.readouterr().out
    words = ["--set", "duration=50ms", "--no-report", "--out", str(tmp_path / "run")]
    assert cli.main(["run", str(folder / "scenario.yaml"), *words]) == 0
    assert warning in capsys.readouterr().out
    result = json.loads((tmp_path / "run/result.json").read_bytes())
    assert [w["source"] for w in result["warnings"]] == ["plant"]
