"""What `stepbus rerun` and `stepbus recover` say, and their exit codes."""

import json
import re
import threading

import pytest
from mcap.opcode import Opcode
from support.messages.recordings import record_ends, rewrite
from support.runs.joints import fault, run_joints, write_scenario

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


class Stopper(Observer):
    """Ends a run when it has come to its pause."""

    def __init__(self, stop):
        self.stop = stop

    def progress(self, progress):
        if progress.phase == "paused":
            self.stop.set()


def cut_off(recording, share):
    """Return a copy of a recording that has this share of what follows its attachments."""
    data = recording.read_bytes()
    chunks = [end for end in record_ends(data)[:-1] if data[end] == Opcode.CHUNK]
    cut = recording.with_name("cut.mcap")
    cut.write_bytes(data[: chunks[int(share * len(chunks))]])
    return cut


@pytest.fixture
def recorded(tmp_path):
    return run_joints(tmp_path, "duration=50ms", in_process=True).recording


def test_an_equal_run_says_so_and_exits_with_0(recorded, tmp_path, capsys):
    code = cli.main(["rerun", str(recorded), "--out", str(tmp_path / "again")])
    said = capsys.readouterr().out
    assert code == 0
    assert "10 steps, byte for byte as recorded" in said
    assert "note:" not in said


def test_another_result_is_shown_and_exits_with_10(tmp_path, capsys):
    first = run_joints(tmp_path, fault("controller", "end", 9), "duration=1s", in_process=True)
    other = "controller.params={fault: end, at: 4}"
    code = cli.main(["rerun", str(first.recording), "--set", other, "--out", str(tmp_path / "b")])
    said = capsys.readouterr().out
    assert code == ExitCode.DIFFERENT
    assert "--set controller.params" in said
    assert "step 5: controller/command" in said


def test_a_failed_run_exits_with_its_own_code(recorded, tmp_path, capsys):
    broken = fault("controller", "raise", 7)
    arguments = ["rerun", str(recorded), "--set", broken, "--out", str(tmp_path / "again")]
    assert cli.main(arguments) == ExitCode.FAULT
    assert "the knee is bent the wrong way" in capsys.readouterr().err


def test_of_a_recording_that_is_cut_off_what_is_there_is_compared(tmp_path, capsys):
    recorded = run_joints(tmp_path, "duration=1s", in_process=True).recording
    cut = cut_off(rewrite(recorded, tmp_path / "fine.mcap", 512), 0.5)
    assert cli.main(["rerun", str(cut), "--out", str(tmp_path / "again"), "--trust"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"as recorded: \d+ steps, after which", said)
    assert "differ" not in said


def test_of_a_run_that_was_interrupted_its_steps_are_compared(tmp_path, capsys):
    source = write_scenario(tmp_path / "source")
    stop = threading.Event()
    options = Options(out=tmp_path / "out", extensions=[Pace(50)], host=InProcess())
    run(load(source, ["duration=1s"]), options, Stopper(stop), stop)
    assert cli.main(["rerun", str(tmp_path / "out"), "--out", str(tmp_path / "again")]) == 0
    said = capsys.readouterr().out
    assert "as recorded: 50 steps" in said


def test_a_run_that_fails_again_before_its_first_step_is_not_as_recorded(tmp_path, capsys):
    broken = fault("controller", "raise", -1)
    failed = run_joints(tmp_path, broken, in_process=True)
    assert cli.main(["rerun", str(failed.recording), "--out", str(tmp_path / "again")]) != 0
    said = capsys.readouterr().out
    assert "as recorded" not in said
    assert "nothing was compared" in said


def test_json_is_all_that_is_printed(recorded, tmp_path, capsys):
    assert cli.main(["rerun", str(recorded), "--json", "--out", str(tmp_path / "again")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["equal"] is answer["messages_equal"] is True
    assert answer["recorded_sha256"] == answer["result"]["sha256"]


@pytest.mark.slow
def test_without_a_folder_the_new_run_is_named_after_the_old_one(recorded, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert [cli.main(["rerun", str(recorded)]) for _ in range(2)] == [0, 0]
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert names == ["out-rerun", "out-rerun-2"]


@pytest.mark.parametrize("command", ["info", "rerun", "recover"])
@pytest.mark.parametrize(
    ("content", "why"), [("", "has 0 bytes"), ("no messages", "is not an MCAP recording")]
)
def test_a_file_that_is_no_recording_is_one_sentence_and_8(command, content, why, tmp_path, capsys):
    path = tmp_path / "notes.txt"
    path.write_text(content)
    assert cli.main([command, str(path)]) == ExitCode.RECORDING == 8
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"stepbus: {path} {why}")


def test_recover_says_what_is_kept_and_what_is_lost(recorded, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[:1000])
    assert cli.main(["recover", str(cut)]) == 0
    said = capsys.readouterr().out
    assert "kept no messages; attachments: 1" in said
    assert "10 of the scenario's 10 steps" in said
    assert f"wrote {tmp_path / 'cut.recovered.mcap'}\n" in said


def test_recover_of_an_undamaged_recording_loses_nothing(recorded, tmp_path, capsys):
    assert cli.main(["recover", str(recorded), "--out", str(tmp_path / "x.mcap")]) == 0
    said = capsys.readouterr().out
    assert "kept 25 messages up to step 10" in said
    assert "lost" not in said
    assert cli.main(["recover", str(recorded), "--json", "--out", str(tmp_path / "y.mcap")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["damage"], answer["lost_bytes"], answer["missing_steps"]) == ("", 0, 0)
