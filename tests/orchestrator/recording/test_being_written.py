"""A recording that a run is writing: commands read what it has, and leave the file to the run."""

import fcntl
import signal
import subprocess
import sys

import pytest
from support.messages.recordings import messages
from support.paused import Paused
from support.surroundings import comes_true

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recording, recover
from stepbus_orchestrator.scenario.load import load


@pytest.fixture
def paused(tmp_path):
    """Return a run of 100 steps that waits behind the first ten."""
    run = Paused(tmp_path / "run", load("two_link", ["duration=500ms"]))
    run.pace.step(10)
    try:
        assert comes_true(lambda: recorded(run.out / "run.mcap") >= 9)
        yield run
    finally:
        run.interrupt.set()
        run.end()


def recorded(path):
    """Return the newest step of a recording; −1 before there is any."""
    try:
        return Recording(path).last_step
    except RecordingFailed:
        return -1


def test_recover_does_not_replace_it(paused, tmp_path, capsys):
    recording = paused.out / "run.mcap"
    assert main(["recover", str(recording), "--in-place"]) == 8
    assert f"{recording} is still being written" in capsys.readouterr().err
    copied = recover(recording, tmp_path / "so_far.mcap")
    assert copied.damage == "it is still being written"
    assert copied.last_step >= 9
    assert paused.end().exit_code == 0
    steps = [step for topic, _, step, _ in messages(recording) if topic == "plant/joint_state"]
    assert steps == list(range(101))
    assert messages(copied.target) == messages(recording)[: copied.messages]


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (["report", "{run}"], 0),
        (["diff", "{run}", "{run}"], 0),
        (["replay", "{run}", "--participant", "plant"], 0),
        (["export", "{run}", "--csv", "{out}"], 0),
    ],
)
def test_commands_read_what_it_has_so_far_and_say_so(paused, tmp_path, capsys, command, code):
    names = {"run": paused.out, "out": tmp_path / "out"}
    assert main([part.format(**names) for part in command]) == code
    said = capsys.readouterr()
    assert "is still being written" in said.out + said.err
    assert "damaged" not in said.out + said.err


def test_what_was_read_stays_when_the_run_goes_on(tmp_path):
    file = McapFile(tmp_path / "run.mcap")
    channel = file.add_channel("plant/a", "Event/1", {})
    for step in range(50):
        file.add(channel, step, bytes([step]) * 1000, step)
    file.flush()
    with Recording(file.path) as early:
        for step in range(50, 200):
            file.add(channel, step, bytes([step]) * 1000, step)
        assert early.cut_short == "is still being written"
        assert early["plant/a"].steps.tolist() == list(range(50))
        file.close()
        assert [entry.data[0] for entry in early["plant/a"].entries()] == list(range(50))
    with Recording(file.path) as late:
        assert (late.cut_short, late.last_step) == ("", 199)


WRITE = """
import sys
from pathlib import Path
from stepbus_orchestrator.recording import McapFile
file = McapFile(Path(sys.argv[1]))
channel = file.add_channel("plant/a", "Event/1", {})
file.add(channel, 0, b"x", 0)
file.flush()
print(flush=True)
sys.stdin.read()
"""


def test_a_writer_that_was_killed_writes_no_more(tmp_path):
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", WRITE, str(path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as writer:
        writer.stdout.readline()
        assert Recording(path).cut_short == "is still being written"
        with pytest.raises(RecordingFailed, match="still being written"):
            recover(path, path, in_place=True)
        writer.send_signal(signal.SIGKILL)
    assert "was truncated" in Recording(path).cut_short
    assert recover(path, path, in_place=True).last_step == 0


def test_a_file_system_without_locks_hinders_nobody(tmp_path, monkeypatch):
    def refuse(*_args):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", refuse)
    file = McapFile(tmp_path / "run.mcap")
    file.add(file.add_channel("plant/a", "Event/1", {}), 0, b"x", 0)
    file.flush()
    with Recording(file.path) as recording:
        assert recording.last_step == 0
    file.close()
    file.check()
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
