"""Equal recordings pass, different ones are shown with their first difference."""

import pytest
from support.runs.joints import fault, write_scenario

from stepbus_orchestrator import cli
from stepbus_orchestrator.analysis.verify import verify
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.scenario.load import load

# Reads something that is another in each run: its own process id.
RACY = """
import os
from stepbus import Description, JointCommand, JointState, Participant

class Racy(Participant):
    def describe(self):
        return {"command": Description(like="joint_state")}

    def update(self, step):
        state = step.read("joint_state", JointState)
        noise = os.getpid() * 1e-9 if step.index >= 7 else 0.0
        return {"command": JointCommand(mode="torque", values=[noise, state.position[1]])}
"""
SHORT = "duration=100ms"


@pytest.fixture
def racy(tmp_path):
    path = write_scenario(tmp_path / "source")
    (path.parent / "racy.py").write_text(RACY)
    return [str(path), "--set", "controller.participant=racy.py:Racy", "--set", SHORT]


@pytest.mark.slow
def test_two_link_gives_one_hash_whatever_the_circumstances(tmp_path):
    scenario, reported = load("two_link", [SHORT]), []
    found = verify(
        scenario,
        runs=3,
        out=tmp_path / "runs",
        on_result=lambda trial, _count: reported.append(trial),
    )
    assert len({trial.result.sha256 for trial in found.results}) == 1
    assert found.different is found.failed is None
    assert reported == list(found.results)
    assert [trial.delays > 0 for trial in reported] == [False, True, True]


@pytest.mark.slow
def test_the_command_prints_a_line_per_run_and_leaves_nothing(own_temp, capsys):
    assert cli.main(["verify", "two_link", "-n", "2", "--set", SHORT]) == 0
    # What takes more than two seconds says how far it is.
    shown = capsys.readouterr().out.splitlines()
    lines = [line for line in shown if not line.startswith("verify two_link: ")]
    assert lines[0].startswith("run 1 of 2: window 64, unix, started")
    assert lines[2] == "2 runs of 20 steps, all identical"
    assert list(own_temp.iterdir()) == []


def test_a_participant_that_is_not_deterministic_is_caught_and_its_runs_are_kept(
    racy, tmp_path, capsys
):
    code = cli.main(["verify", *racy, "-n", "3", "--out", str(tmp_path / "runs")])
    output = capsys.readouterr()
    assert code == ExitCode.DIFFERENT == 10
    assert "run 2 differs from run 1" in output.err
    assert "step 7: controller/command: values[hip]" in output.out
    kept = sorted(path.name for path in (tmp_path / "runs").glob("*/run.mcap"))
    folders = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert (kept, folders) == (["run.mcap"] * 2, ["1", "2"])


def test_a_run_that_fails_ends_it_with_its_own_code(tmp_path, capsys):
    path = write_scenario(tmp_path / "source")
    override = fault("controller", "raise", 7)
    keep = str(tmp_path / "runs")
    code = cli.main(["verify", str(path), "--set", override, "--out", keep])
    assert code == ExitCode.FAULT
    assert "the knee is bent the wrong way" in capsys.readouterr().err


@pytest.mark.parametrize("count", ["1", "0", "-3", "many"])
def test_a_number_of_runs_that_compares_nothing_is_refused(count, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(["verify", "two_link", "-n", count])
    assert caught.value.code == 2
    assert "-n" in capsys.readouterr().err
