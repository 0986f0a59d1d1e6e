"""What `stepbus rerun` and `stepbus recover` say, and their exit codes."""

import json

import pytest
from support.runs.joints import fault, run_joints

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ExitCode


@pytest.fixture
def recorded(tmp_path):
    return run_joints(tmp_path, "duration=50ms", in_process=True).recording


def test_an_equal_run_says_so_and_exits_with_0(recorded, tmp_path, capsys):
    code = cli.main(["rerun", str(recorded), "--out", str(tmp_path / "again")])
    said = capsys.readouterr().out
    assert code == 0
    assert "10 steps, byte for byte as recorded\nsha256" in said
    assert "note:" not in said


def test_another_result_is_shown_and_exits_with_10(tmp_path, capsys):
    first = run_joints(
        tmp_path, fault("controller", "controller", "end", 9), "duration=1s", in_process=True
    )
    other = "controller.exec=[python, joints.py, controller, end, '4']"
    code = cli.main(["rerun", str(first.recording), "--set", other, "--out", str(tmp_path / "b")])
    said = capsys.readouterr().out
    assert code == ExitCode.DIFFERENT
    assert "note: the scenario is not the recorded one: --set controller.exec" in said
    assert (
        "first divergence: step 5: controller/command: the first has a message, the second has none"
        in said
    )


def test_a_failed_run_exits_with_its_own_code(recorded, tmp_path, capsys):
    broken = fault("controller", "controller", "raise", 7)
    arguments = ["rerun", str(recorded), "--set", broken, "--out", str(tmp_path / "again")]
    assert cli.main(arguments) == ExitCode.FAULT
    assert "the knee is bent the wrong way" in capsys.readouterr().err


def test_json_is_all_that_is_printed(recorded, tmp_path, capsys):
    assert cli.main(["rerun", str(recorded), "--json", "--out", str(tmp_path / "again")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["equal"] is answer["messages_equal"] is True
    assert answer["recorded_sha256"] == answer["result"]["sha256"]


def test_without_a_folder_the_new_run_is_named_after_the_old_one(recorded, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert [cli.main(["rerun", str(recorded)]) for _ in range(2)] == [0, 0]
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert names == ["out-rerun", "out-rerun-2"]


@pytest.mark.parametrize("command", ["rerun", "recover"])
def test_a_file_that_is_no_recording_is_one_sentence_and_8(command, tmp_path, capsys):
    path = tmp_path / "notes.txt"
    path.write_text("these are no messages")
    assert cli.main([command, str(path)]) == ExitCode.RECORDING == 8
    said = capsys.readouterr().err.splitlines()
    assert said == [
        f"stepbus: {path} is not an MCAP recording: it does not start with its magic bytes"
    ]


def test_recover_says_what_is_kept_and_what_is_lost(recorded, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[:1000])
    assert cli.main(["recover", str(cut)]) == 0
    said = capsys.readouterr().out
    assert "kept no messages; attachments: 1, metadata records: 0\n" in said
    assert "on; 10 of the scenario's 10 steps are missing\n" in said
    assert f"wrote {tmp_path / 'cut.recovered.mcap'}\n" in said


def test_recover_of_an_undamaged_recording_counts_its_messages(recorded, tmp_path, capsys):
    assert cli.main(["recover", str(recorded), "--out", str(tmp_path / "x.mcap")]) == 0
    said = capsys.readouterr().out
    assert "undamaged\nkept 25 messages up to step 10; " in said
    assert "lost" not in said


def test_recover_answers_in_json(recorded, tmp_path, capsys):
    assert cli.main(["recover", str(recorded), "--json", "--out", str(tmp_path / "x.mcap")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["damage"], answer["lost_bytes"], answer["missing_steps"]) == ("", 0, 0)
