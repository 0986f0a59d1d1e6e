"""`stepbus selftest`: what it finds wrong with the joints of a plant, and what it lets pass."""

import json
import re
import textwrap
from importlib import resources

import pytest

from stepbus_orchestrator import load
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.diagnosis.selftest import selftest
from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_schemas import WiringError

PROGRAM = """
import math
import sys

import stepbus

FAULT = %r
NAMES = ["a", "b", "slide"]


class Perfect(stepbus.Participant):
    '''Joints that are where they are told to be; one thing about them may be wrong.'''

    q = [0.1, 0.0, 0.0]

    def describe(self):
        return {"state": stepbus.Description(
            names=NAMES,
            limits={"lower": [-1.0, -4.0, 0.0], "upper": [1.0, 4.0, 0.2], "velocity": [2.0] * 3},
            details={"type": ["revolute", "revolute", "prismatic"],
                     "mode": ["passive" if FAULT == "passive" else "position"] + ["position"] * 2},
        )}

    def start(self, inputs):
        self.names = inputs["command"].names

    def output(self, step):
        q = [math.degrees(self.q[0]), *self.q[1:]] if FAULT == "degrees" else self.q
        return {"state": stepbus.JointState(position=q)}

    def update(self, step):
        if FAULT == "crash":
            raise RuntimeError("no power")
        told = dict(zip(self.names, step.read("command").values))
        a, b, slide = (told.get(name, 0.1) for name in NAMES)
        self.q = {
            "swapped": [b + 0.1, a - 0.1, slide],
            "backwards": [0.2 - a, b, slide],
            "stuck": [0.1, b, slide],
            "short": [0.1 + 0.9 * (a - 0.1), b, slide],
            "coupled": [a, b + 0.5 * (a - 0.1), slide],
        }.get(FAULT, [a, b, slide])


class Controller(stepbus.Participant):
    def describe(self):
        return {"command": stepbus.Description(names=NAMES)}


raise SystemExit(stepbus.main(Controller if "controller" in sys.argv else Perfect))
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


def verdicts(folder, fault=""):
    found = selftest(load(scenario(folder, fault)), 1.5708)
    return {verdict.joint: verdict for verdict in found.joints}


def test_joints_that_do_as_they_are_told_pass(tmp_path):
    found = verdicts(tmp_path)
    assert [verdict.findings for verdict in found.values()] == [[], [], []]
    assert [found[name].commanded for name in found] == [1.0, 1.5708, 0.05]
    assert found["b"].measured == pytest.approx(1.5708)


@pytest.mark.parametrize(
    ("fault", "finding"),
    [
        ("degrees", r"reads 57\.3 for 1\.0000 rad; does it measure in degrees\?"),
        ("swapped", r"does not move; b moves in its place: are they swapped\?"),
        ("backwards", r"moves in the other direction, by -51\.57°"),
        ("stuck", r"does not move; is something in its way\?"),
        ("short", r"ends 5\.16° from where it was sent"),
        ("coupled", r"moves b as well, by 25\.78°"),
    ],
)
def test_what_is_wrong_with_a_joint_is_named(tmp_path, fault, finding):
    verdict = verdicts(tmp_path, fault)["a"]
    assert not verdict.ok
    assert re.match(finding, verdict.findings[0])


def test_a_passive_joint_is_not_tested(tmp_path):
    verdict = verdicts(tmp_path, "passive")["a"]
    assert (verdict.ok, verdict.commanded) == (True, None)


def test_torque_joints_are_pushed_and_put(capsys):
    assert main(["selftest", "two_link", "--json"]) == ExitCode.FINISHED
    found = json.loads(capsys.readouterr().out)
    assert [joint["measured"] for joint in found["joints"]] == pytest.approx([1.5708] * 2, abs=1e-2)


def test_velocity_joints_are_turned(tmp_path):
    text = WORLD.replace("MODE", "velocity")
    assert [v.findings for v in selftest(load(two_link_in(tmp_path, text)), 1.0).joints] == [[], []]


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
