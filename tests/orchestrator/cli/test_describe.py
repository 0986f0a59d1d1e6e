"""`stepbus describe`: what the participants say, and nothing left behind."""

import json
import textwrap
import threading
from pathlib import Path

import pytest
from support.runs.joints import leftovers

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_orchestrator.run.describe import describe
from stepbus_orchestrator.scenario.load import load

PROGRAM = """
import stepbus

class Sensor(stepbus.Participant):
    def describe(self):
        return {"state": stepbus.Description(%s)}

    def update(self, step):
        return {"state": stepbus.JointState(position=[0.0, 0.0])}

raise SystemExit(stepbus.main(Sensor))
"""

SCENARIO = """
name: sensor
step: 5ms
participants:
  sensor: {exec: [python, sensor.py], outputs: {state: JointState/1}}
"""


def sensor(folder: Path, description: str) -> Path:
    """Write a scenario with one participant that describes its output so; return its file."""
    (folder / "sensor.py").write_text(PROGRAM % description)
    (folder / "scenario.yaml").write_text(textwrap.dedent(SCENARIO))
    return folder / "scenario.yaml"


@pytest.fixture(scope="module")
def two_link():
    return {participant.participant: participant for participant in describe(load("two_link"))}


def test_participants_come_in_the_order_of_the_schedule_with_their_wiring(two_link):
    assert list(two_link) == ["plant", "mission", "controller"]
    rows = [(item.port, item.type, item.source) for item in two_link["controller"].inputs]
    assert rows == [
        ("joint_state", "JointState/1", "plant.joint_state"),
        ("reference", "JointReference/1", "mission.reference"),
    ]
    taken = {output.port: output.taken_by for output in two_link["controller"].outputs}
    assert taken == {"command": ["plant.command"], "status": []}


def test_the_table_has_a_row_for_each_joint(capsys):
    assert main(["describe", "two_link"]) == 0
    lines = capsys.readouterr().out.splitlines()
    cells = [line.split() for line in lines if "revolute" in line]
    assert cells == [
        [str(index), name, "revolute", "torque", "-6.2832", "6.2832", "20", "50", "on"]
        for index, name in enumerate(("joint1", "joint2"))
    ]


def test_an_infinite_limit_is_a_dash_and_null(tmp_path, capsys):
    text = 'names=["a", "b"], limits={"upper": [1.0, float("inf")]}'
    scenario = str(sensor(tmp_path, text))
    assert (main(["describe", scenario]), main(["describe", scenario, "--json"])) == (0, 0)
    table, _, told = capsys.readouterr().out.partition("[\n")
    assert table.splitlines()[-1].split() == ["1", "b", "-"]
    (participant,) = json.loads("[" + told)
    assert participant["outputs"][0]["description"]["limits"]["upper"] == [1, None]


def test_names_of_an_output_that_is_like_an_input_are_those_of_the_input(tmp_path):
    main(["new", str(tmp_path / "mine")])
    described = {
        participant.participant: participant for participant in describe(load(tmp_path / "mine"))
    }
    said = described["controller"].outputs[0].description
    assert (said.like, said.names) == ("joint_state", ["joint1", "joint2"])


@pytest.mark.parametrize(
    ("description", "sentence"),
    [
        ('names=["a", "b"], limits={"lower": [1.0]}', "limits.lower has 1 values for 2 names"),
        ('names=["a"], details={"type": ["x", "y"]}', "details.type has 2 values for 1 names"),
        ('names=["a", "a"]', "a is listed twice"),
        ('like="stat"', "state is like 'stat', which is not one of its inputs; it has none"),
    ],
)
def test_a_description_that_does_not_fit_together_is_refused(tmp_path, description, sentence):
    with pytest.raises(RunFailure, match=f"sensor .* incorrectly: .*{sentence}") as caught:
        describe(load(sensor(tmp_path, description)))
    assert caught.value.code == ExitCode.START


def test_no_file_and_no_process_is_left(own_temp, tmp_path):
    describe(load(sensor(tmp_path, "")))
    assert (list(own_temp.iterdir()), leftovers(tmp_path)) == ([], [])


def test_an_interrupt_ends_it_and_leaves_nothing(own_temp, tmp_path):
    interrupt = threading.Event()
    interrupt.set()
    with pytest.raises(RunFailure, match="interrupted") as caught:
        describe(load(sensor(tmp_path, "")), interrupt)
    assert caught.value.code == ExitCode.INTERRUPTED
    assert (list(own_temp.iterdir()), leftovers(tmp_path)) == ([], [])
