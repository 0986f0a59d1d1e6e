"""A command that runs a scenario for itself leaves nothing, and quotes the log that it removes."""

import pytest
from support.runs.joints import write_scenario

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode, RecordingFailed, StartFailed
from stepbus_orchestrator.run.folder import scratch_folder


@pytest.fixture
def broken(tmp_path):
    """Return a scenario whose controller ends with an error of its own."""
    path = write_scenario(tmp_path / "source")
    program = path.with_name("joints.py")
    text = program.read_text()
    program.write_text(
        text.replace("ROLE, FAULT", 'print("one line")\nprint(1 / 0)\nROLE, FAULT', 1)
    )
    return path


def test_a_describe_that_fails_quotes_the_log_and_leaves_nothing(own_temp, broken, capsys):
    assert main(["describe", str(broken)]) == ExitCode.START
    said = capsys.readouterr().err
    assert "its log ends below\n  one line\n" in said
    assert "\n  ZeroDivisionError: division by zero" in said
    assert not list(own_temp.iterdir())


@pytest.mark.slow
def test_a_replay_that_fails_quotes_the_log_and_leaves_nothing(own_temp, tmp_path, capsys):
    path = write_scenario(tmp_path / "source")
    assert main(["run", str(path), "--set", "duration=50ms", "--out", str(tmp_path / "run")]) == 0
    program = path.with_name("joints.py")
    # More than is in the sentence itself.
    text = "for gain in range(9):\n    print('gain', gain)\nraise SystemExit('no such gain')\n"
    program.write_text(text)
    recording = str(tmp_path / "run" / "run.mcap")
    code = main(["replay", recording, "--participant", "controller", "--source", str(path)])
    assert code == ExitCode.START
    said = capsys.readouterr().err
    assert "its log ends below\n" in said
    assert "  gain 8\n  no such gain\n" in said
    assert not list(own_temp.iterdir())


def test_only_logs_that_are_named_are_quoted(own_temp):
    def fail():
        with scratch_folder("test") as folder:
            (folder / "a.log").write_text("a speaks\n")
            (folder / "b.log").write_text("b speaks\n")
            (folder / "c.log").touch()
            raise StartFailed(f"x; its log: {folder}/b.log; y; its log: {folder}/c.log")

    with pytest.raises(StartFailed) as caught:
        fail()
    assert str(caught.value).endswith("; y; its log is empty\n  b speaks")
    assert not list(own_temp.iterdir())


def test_where_no_folder_can_be_made_the_sentence_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(RecordingFailed, match="set TMPDIR"), scratch_folder("test"):
        pass
