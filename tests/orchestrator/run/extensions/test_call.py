"""Calls beside the step loop: answered between steps, recorded when they change something."""

import json
import stat
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from support.messages.recordings import messages
from support.runs.asker import Asker
from support.runs.joints import run_joints, write_scenario

from stepbus_orchestrator.cli import attach, main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.live_file import LIVE_FILE, Live, call
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import Endpoint
from stepbus_schemas import CallReply, JointState

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def asked(folder, *calls, overrides=()):
    """Return result and answers of a run in which calls are made when it pauses at step 20."""
    scenario = load(write_scenario(folder / "source"), overrides)
    out = folder / "out"
    pace = Pace(20)
    asker = Asker(
        pace, [lambda words=words: call(out, *words[:2], args=words[2:]) for words in calls]
    )
    result = run(scenario, Options(out=out, extensions=[pace]), asker)
    if asker.thread is not None:
        asker.thread.join()
    return result, asker.answers


def positions(result, joint):
    rows = (
        msgspec.msgpack.decode(d, type=JointState)
        for t, _, _, d in messages(result.recording)
        if t == "plant/joint_state"
    )
    return [row.position[joint] for row in rows]


@pytest.mark.parametrize("transport", ["unix", "tcp"])
def test_a_question_is_answered_between_steps_and_changes_nothing(tmp_path, transport):
    overrides = [f"bus.transport={transport}"]
    plain = run_joints(tmp_path / "plain", in_process=True)
    result, answers = asked(tmp_path, ["plant", "position", 1], overrides=overrides)
    assert (result.exit_code, result.sha256) == (0, plain.sha256)
    assert (answers[0].step, answers[0].value) == (20, positions(result, 1)[20])


def test_what_a_call_changes_is_recorded_with_its_step(tmp_path):
    result, answers = asked(tmp_path, ["plant", "put", 0, 0.75])
    assert (result.exit_code, answers[0].step) == (0, 20)
    assert positions(result, 0)[20] == 0.75
    (recorded,) = recorded_calls(Recording(result.recording))
    assert (recorded.step, recorded.participant) == (20, "plant")
    assert (recorded.method, recorded.args) == ("put", [0, 0.75])


@pytest.mark.slow
def test_a_run_with_calls_is_run_again_and_replayed(tmp_path):
    result, _ = asked(tmp_path, ["plant", "put", 0, 0.75], ["plant", "put", 1, 9.5])
    assert Preparation(result.recording, tmp_path / "again").run().equal
    assert replay(result.recording, "plant").equal
    assert replay(result.recording, "controller").equal


SENTENCES = [
    (["plnt", "position", 0], "no participant 'plnt'; did you mean 'plant'?"),
    (["plant", "positon", 0], "plant has no call 'positon'; did you mean 'position'?"),
    (["controller", "position", 0], "controller does not accept calls"),
    (["plant", "position"], "position: missing a required argument: 'joint'"),
    (["plant", "position", 7], "position: list index out of range"),
    (["plant", "put", 0, 9.5], "put: 9.5 is beyond the stop"),
    (["plant", "put", "x", "y"], "put: bad operand type for abs(): 'str'"),
    (["plant", "text", 70_000], "the answer has 70050 bytes"),
    (["plant", "put", 0, "x" * 70_000], "more than the 60000"),
]


def test_a_call_that_cannot_be_answered_says_why_and_the_run_goes_on(tmp_path):
    result, answers = asked(tmp_path, *(words for words, _ in SENTENCES), ["plant", "position", 0])
    for answer, (_, words) in zip(answers[:-1], SENTENCES, strict=True):
        assert words in answer
    assert (result.exit_code, answers[-1].step) == (0, 20)


def test_the_file_of_a_live_run_follows_no_link_and_takes_no_file_of_others(tmp_path):
    (tmp_path / "victim").write_text("kept")
    live = Live(run="r", token="t", endpoint=Endpoint(listen=[], connect=[]))
    for plant in (Path.symlink_to, Path.hardlink_to):
        (tmp_path / LIVE_FILE).unlink(missing_ok=True)
        plant(tmp_path / LIVE_FILE, tmp_path / "victim")
        live.save(tmp_path)
        assert (tmp_path / "victim").read_text() == "kept"
        assert (tmp_path / LIVE_FILE).lstat().st_mode == stat.S_IFREG | 0o600


def test_the_calls_of_all_participants_can_be_listed(tmp_path):
    result, answers = asked(tmp_path, [])
    assert result.exit_code == 0
    assert answers[0].value["plant"]["put"] == {
        "help": "I RAD: puts a joint somewhere",
        "changes": True,
    }
    assert answers[0].value["mission"] == {}


@pytest.mark.slow
def test_a_call_that_is_not_answered_is_blamed_on_the_participant(tmp_path):
    overrides = ["plant.step_timeout=2s", "plant.stop_timeout=500ms"]
    result, answers = asked(tmp_path, ["plant", "sleep", 30], overrides=overrides)
    late = (result.exit_code, result.participant, result.at_step)
    assert late == (ExitCode.STEP_TIMEOUT, "plant", 20)
    assert "has not answered the call sleep for " in result.reason
    assert answers == ["the run has ended"]


def test_there_is_nobody_to_ask_when_no_run_goes_on(tmp_path, capsys):
    assert main(["call", str(tmp_path), "plant", "position"]) == ExitCode.SCENARIO
    assert "no live run in" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_line_asks_from_a_second_terminal(tmp_path):
    answers = []
    command = [sys.executable, "-m", "stepbus_orchestrator.cli", "call", tmp_path / "out"]

    def ask(*words):
        done = subprocess.run([*command, *words], capture_output=True, text=True, check=True)
        answers.append(done.stdout)

    pace = Pace(20)
    asker = Asker(
        pace,
        [
            lambda: ask("plant", "put", "1", "-0.5"),
            lambda: ask("plant", "position", "1", "--json"),
            ask,
        ],
    )
    scenario = load(write_scenario(tmp_path / "source"))
    result = run(scenario, Options(out=tmp_path / "out", extensions=[pace]), asker)
    asker.thread.join()
    assert result.exit_code == 0
    assert answers[0] == "null\n"
    assert json.loads(answers[1]) == {"step": 20, "value": -0.5}
    assert "puts a joint somewhere" in answers[2]


def test_the_list_of_calls_shows_units_in_brackets(monkeypatch, capsys):
    offered = {"plant": {"angle": {"help": "NAME: where it is [rad]", "changes": False}}}
    monkeypatch.setattr(attach, "call", lambda _folder: CallReply(value=offered))
    assert main(["call", "runs/some"]) == 0
    assert "where it is [rad]" in capsys.readouterr().out
    assert main(["call", "runs/some", "plnt"]) != 0
    assert "did you mean 'plant'?" in capsys.readouterr().err
