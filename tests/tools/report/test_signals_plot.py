"""`stepbus plot`: any signals, one picture."""

import pytest
from support.messages.recordings import write
from support.paths import TESTS

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Description, JointState
from stepbus_tools.report.charts import find_signals

LOG = TESTS / "scenarios/golden/two_link.mcap"


@pytest.fixture
def recording():
    with Recording(LOG) as opened:
        yield opened


def test_signals_are_drawn_into_one_picture(tmp_path, capsys):
    target = tmp_path / "plot.svg"
    signals = ["controller.command", "plant.joint_state.position[0]"]
    assert cli.main(["plot", str(LOG), *signals, "--out", str(target)]) == 0
    assert capsys.readouterr().out == f"wrote {target}\n"
    assert target.read_text().count("axes_") >= 2


def test_without_a_signal_those_that_there_are_are_listed(capsys):
    assert cli.main(["plot", str(LOG)]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert listed[0] == "plant.joint_state.position"
    assert "controller.status.warnings" not in listed


@pytest.mark.parametrize("index", ["1", "joint2"])
def test_an_element_is_named_by_its_index_or_its_joint(recording, index):
    (signal,) = find_signals(recording, f"plant.joint_state.position[{index}]")
    values = recording["plant.joint_state"].position[:, 1]
    (line,) = signal.lines
    assert (line.label, list(line.points[1])) == ("joint2", list(values))


def test_a_port_stands_for_all_of_its_numbers(recording):
    titles = [signal.title for signal in find_signals(recording, "plant/joint_state")]
    assert titles == [f"plant.joint_state.{name}" for name in ("position", "velocity", "effort")]


def test_a_joint_that_slides_has_metres_and_a_panel_of_its_own(tmp_path):
    joints = Description(names=["turn", "lift"], details={"type": ["revolute", "prismatic"]})
    states = [JointState(position=[1.0, 0.1], effort=[2.0, 3.0])]
    path = write(tmp_path / "run.mcap", joint_state=("JointState/1", joints, states))
    with Recording(path) as opened:
        shown = find_signals(opened, "plant.joint_state")
    panels = [(one.unit, [line.label for line in one.lines]) for one in shown]
    assert panels == [("rad", ["turn"]), ("m", ["lift"]), ("N·m", ["turn"]), ("N", ["lift"])]


@pytest.mark.parametrize(
    ("signal", "sentence"),
    [
        ("plant.joint_stat", "did you mean 'plant/joint_state'?"),
        ("plant.joint_state.positio", "has no numeric field 'positio'; it has position, velocity,"),
        ("plant.joint_state.position[7]", "no element [7]; it has [joint1], [joint2]\n"),
        ("plant", "is not a signal; write e.g. plant.joint_state.position[0]"),
    ],
)
def test_what_cannot_be_plotted_is_one_sentence(signal, sentence, capsys):
    assert cli.main(["plot", str(LOG), signal]) == ExitCode.SCENARIO
    assert sentence in capsys.readouterr().err
