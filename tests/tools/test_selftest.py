"""`stepbus selftest`: what it finds wrong with the joints of a plant, and what it lets pass."""

import json
import re
import textwrap
from importlib import resources

import pytest

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import WiringError
from stepbus_tools.selftest import selftest

PROGRAM = """
import math
import sys

import stepbus

FAULT = %r
# Joint: its type, where it is at the start, and its stops.
JOINTS = {
    "turns": ("revolute", 0.1, -4.0, 4.0),
    "slides": ("prismatic", 0.0, 0.0, 0.2),
    "passive": ("revolute", 0.1, -1.0, 1.0),
    "degrees": ("revolute", 0.1, -1.0, 1.0),
    "swapped": ("revolute", 0.1, -1.0, 1.0),
    "backwards": ("revolute", 0.1, -1.0, 1.0),
    "stuck": ("revolute", 0.1, -1.0, 1.0),
    "short": ("revolute", 0.1, -1.0, 1.0),
    "coupled": ("revolute", 0.1, -1.0, 1.0),
    "driven": ("revolute", 0.0, -4.0, 4.0),
}
NAMES = list(JOINTS)
TYPES, STARTS, LOWER, UPPER = (list(column) for column in zip(*JOINTS.values()))


class Plant(stepbus.Participant):
    '''Joints that are where they are told to be, and some with one thing wrong about them.'''

    q = dict(zip(NAMES, STARTS))

    def describe(self):
        return {"state": stepbus.Description(
            names=NAMES,
            limits={"lower": LOWER, "upper": UPPER, "velocity": [2.0] * len(NAMES)},
            details={"type": TYPES,
                     "mode": ["passive" if name == "passive" else "position" for name in NAMES]},
        )}

    def start(self, inputs):
        self.names = inputs["command"].names

    def output(self, step):
        q = {**self.q, "degrees": math.degrees(self.q["degrees"])}
        return {"state": stepbus.JointState(position=[q[name] for name in NAMES])}

    def update(self, step):
        if FAULT == "crash":
            raise RuntimeError("no power")
        told = dict(zip(NAMES, STARTS)) | dict(zip(self.names, step.read("command").values))
        self.q = {
            **told,
            "swapped": told["driven"] + 0.1,
            "driven": (told["swapped"] - 0.1) + 0.5 * (told["coupled"] - 0.1),
            "backwards": 0.2 - told["backwards"],
            "stuck": 0.1,
            "short": 0.1 + 0.9 * (told["short"] - 0.1),
        }


class Controller(stepbus.Participant):
    def describe(self):
        return {"command": stepbus.Description(names=[name for name in NAMES if name != "passive"])}


raise SystemExit(stepbus.main(Controller if "controller" in sys.argv else Plant))
"""

SCENARIO = """
name: perfect
step: 20ms
duration: 1s
participants:
  plant:
    exec: [python, plant.py]
    publishes: first
    inputs: {command: controller.command}
    outputs: {state: JointState/1}
  controller:
    exec: [python, plant.py, controller]
    inputs: {state: plant.state}
    outputs: {command: JointCommand/1}
"""


WORLD = """
gravity: [0, 0, 0]
bodies: {arm: {urdf: two_link.urdf, fixed_base: true, joint_defaults: {mode: MODE}}}
"""


def two_link_in(folder, world):
    """Copy the scenario two_link with another world."""
    source = resources.files("stepbus_scenarios") / "two_link"
    for name in ("scenario.yaml", "two_link.urdf"):
        (folder / name).write_text((source / name).read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "world.yaml").write_text(world)
    return folder


def scenario(folder, fault=""):
    """Write a scenario whose plant has a fault; return its folder."""
    (folder / "plant.py").write_text(PROGRAM % fault)
    (folder / "scenario.yaml").write_text(textwrap.dedent(SCENARIO))
    return folder


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory):
    """Return what was found out about each joint, by its name."""
    found = selftest(load(scenario(tmp_path_factory.mktemp("plant"))), 1.5708)
    return {verdict.joint: verdict for verdict in found.joints}


def test_joints_that_do_as_they_are_told_pass(verdicts):
    assert [verdicts[name].findings for name in ("turns", "slides")] == [[], []]
    assert [verdicts[name].commanded for name in ("turns", "slides")] == [1.5708, 0.05]
    assert verdicts["turns"].measured == pytest.approx(1.5708)


@pytest.mark.parametrize(
    ("joint", "finding"),
    [
        ("degrees", r"reads 57\.3 for 1\.0000 rad; does it measure in degrees\?"),
        ("swapped", r"does not move; driven moves instead: are they swapped\?"),
        ("backwards", r"moves in the other direction, by -51\.57°"),
        ("stuck", r"does not move; is something in its way\?"),
        ("short", r"stops 5\.16° from its target"),
        ("coupled", r"moves driven as well, by 25\.78°"),
    ],
)
def test_what_is_wrong_with_a_joint_is_named(verdicts, joint, finding):
    assert not verdicts[joint].ok
    assert verdicts[joint].commanded == 1.0
    assert re.match(finding, verdicts[joint].findings[0])


def test_a_passive_joint_is_not_tested(verdicts):
    assert (verdicts["passive"].ok, verdicts["passive"].commanded) == (True, None)


@pytest.mark.slow
def test_torque_joints_are_pushed_and_put(capsys):
    assert main(["selftest", "two_link", "--json"]) == ExitCode.FINISHED
    found = json.loads(capsys.readouterr().out)
    assert [joint["measured"] for joint in found["joints"]] == pytest.approx([1.5708] * 2, abs=1e-2)


@pytest.mark.slow
def test_velocity_joints_are_turned(tmp_path):
    text = WORLD.replace("MODE", "velocity")
    assert [v.findings for v in selftest(load(two_link_in(tmp_path, text)), 1.0).joints] == [[], []]


@pytest.mark.slow
def test_a_joint_without_effort_fails_the_test(tmp_path, capsys):
    folder = two_link_in(tmp_path, WORLD.replace("MODE", "position"))
    arguments = ["selftest", str(folder), "--set", "plant.params.effort.joint2=0"]
    assert main(arguments) == ExitCode.NONCONFORMING
    assert "1 of 2 joints pass" in capsys.readouterr().out


def test_a_plant_that_fails_ends_the_test_with_the_code_of_its_run(tmp_path):
    with pytest.raises(RunFailure, match="no power") as caught:
        selftest(load(scenario(tmp_path, "crash")), 1.0)
    assert caught.value.code == ExitCode.FAULT


def test_a_scenario_without_joints_is_refused(tmp_path):
    folder = scenario(tmp_path)
    text = (folder / "scenario.yaml").read_text().replace("JointState/1", "Event/1")
    (folder / "scenario.yaml").write_text(text)
    with pytest.raises(WiringError, match="there is nothing to test"):
        selftest(load(folder), 1.0)
