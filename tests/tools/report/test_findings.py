"""What makes a run look better than it was has a line in its summary."""

import math

import numpy as np
import pytest
from support.messages.recordings import write
from support.paths import GOLDEN_LOGS, TESTS

from stepbus_orchestrator import cli
from stepbus_orchestrator.cli.new import write_starter
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import Description, Goal, JointState
from stepbus_tools.report.findings import Count, findings

DELAYED = "plant.inputs.command={from: controller.command, delay: 1}"


def run_it(folder, out, *overrides):
    return run(load(folder, overrides), Options(out=out, host=InProcess()))


def found(tmp_path, *overrides):
    result = run_it("two_link", tmp_path / "run", "duration=500ms", *overrides)
    assert result.exit_code == 0, result.reason
    return findings(Recording(result.recording))


@pytest.mark.parametrize("log", GOLDEN_LOGS, ids=lambda path: path.stem)
def test_shipped_scenarios_have_none(log):
    assert findings(Recording(log)) == []


def test_a_torque_that_the_plant_cuts_is_named(tmp_path):
    limits = ["controller.params.effort_limit=100", "plant.params.effort.joint1=10"]
    (line,) = found(tmp_path, *limits)
    assert "to 10 N·m in 86 % of the steps" in line
    assert "up to 100 N·m were commanded" in line


def test_a_command_that_is_no_number_does_not_hide_the_largest():
    count = Count()
    count.take(np.array([math.nan, 5.0, -9.0]), -1.0, 1.0)
    assert (count.worst, count.share) == (-9.0, "67 % of the steps")


def test_a_recording_of_another_program_may_have_any_inputs(tmp_path):
    recording = Recording(TESTS / "scenarios/golden" / "two_link.mcap")
    recording.scenario = {"participants": {"plant": {"inputs": [1]}, "controller": {"inputs": 3}}}
    assert findings(recording) == []


def test_a_joint_that_saturates_in_many_steps_is_named(tmp_path):
    (line,) = found(tmp_path, "controller.params.effort_limit=10")
    assert line.startswith("controller.command: joint1 is saturated")


def test_a_reference_beyond_a_stop_is_named(tmp_path):
    lines = found(tmp_path, "mission.params.amplitude=57")
    sentence = "joint2 is commanded to 57 rad, beyond its stop at 6.283 rad"
    assert f"mission.reference: {sentence}" in lines


def goals(tmp_path, *sent, joint_type="revolute", joint="elbow"):
    """Return the findings of a recording with goals for a joint with stops at ±2."""
    limits = {"lower": [-2.0], "upper": [2.0]}
    elbow = Description(names=[joint], limits=limits, details={"type": [joint_type]})
    joints = ("JointState/1", elbow, [JointState(position=[0.0])])
    path = write(tmp_path / "run.mcap", goal=("Goal/1", [], list(sent)), joints=joints)
    return findings(Recording(path))


def test_a_goal_beyond_a_stop_is_named(tmp_path):
    right = Goal(id=1, type="move_joints", joints=["elbow"], values=[1.0])
    assert goals(tmp_path, right) == []
    wrong = Goal(id=2, type="move_joints", joints=["elbow"], values=[90.0])
    sentence = "plant.goal: elbow is commanded to 90 rad, beyond its stop at 2 rad"
    assert goals(tmp_path, right, wrong) == [sentence]
    assert goals(tmp_path, wrong, joint="left/elbow") == [sentence]
    (line,) = goals(tmp_path, wrong, joint_type="prismatic")
    assert line.endswith("beyond its stop at 2 m")


def test_the_summary_has_the_findings_and_the_figures_without_a_report(tmp_path, capsys):
    words = ["run", "two_link", "--in-process", "--no-report", "--set", "duration=500ms"]
    limit = ["--set", "plant.params.effort.joint1=10"]
    assert cli.main([*words, *limit, "--out", str(tmp_path / "run")]) == 0
    said = capsys.readouterr().out
    assert "plant clips joint1 of" in said
    assert "tracking RMSE of the whole run" in said
    assert not (tmp_path / "run/report.png").exists()


def test_an_output_that_never_published_is_a_warning(tmp_path):
    write_starter(tmp_path / "arm", "python")
    program = tmp_path / "arm/controller.py"
    text = program.read_text()
    program.write_text(
        text.replace('return {"command": stepbus.Joint', '{"command": stepbus.Joint')
    )
    result = run_it(tmp_path / "arm", tmp_path / "run", "duration=100ms")
    (warned,) = result.warnings
    assert (warned.source, warned.level) == ("controller.command", "warning")
    assert "never published in 20 steps" in warned.text


def test_a_delayed_command_suits_a_plant_that_publishes_last(tmp_path):
    first = run_it("two_link", tmp_path / "first", "duration=200ms")
    last = run_it("two_link", tmp_path / "last", "duration=200ms", "plant.publishes=last", DELAYED)
    assert not last.warnings
    for topic in ("plant/joint_state", "controller/command"):
        states = [dict(Recording(r.recording).messages(topic)) for r in (first, last)]
        # One that publishes first closes the run with the state after its last step.
        states[0].pop(40, None)
        assert states[0] == states[1]
        assert len(states[1]) == 40


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ("[float('nan'), 0.0]", "values of joint joint1 is nan, not a finite number"),
        ("[0.0]", "values has 1 entries for 2 joints (joint1, joint2)"),
    ],
)
def test_a_command_that_no_plant_can_use_blames_its_sender(tmp_path, values, text):
    write_starter(tmp_path / "arm", "python")
    program = tmp_path / "arm/controller.py"
    program.write_text(program.read_text().replace("values=torque", f"values={values}"))
    result = run_it(tmp_path / "arm", tmp_path / "run", "duration=100ms")
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "controller")
    assert f"controller.command (input command): {text} (seen by plant" in result.reason
