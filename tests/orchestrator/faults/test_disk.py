"""A disk that fills up, a folder that is removed, a file that is changed while a run writes it."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recording, recover
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import JointState, encode

pytestmark = pytest.mark.slow

STEPBUS = str(Path(sys.executable).with_name("stepbus"))


@pytest.mark.slow
def test_a_full_disk_has_room_for_the_index_of_a_long_recording(small_disk, monkeypatch):
    # Of 64 KiB, the chunks of 10⁷ steps would have as large an index.
    monkeypatch.setattr(McapFile, "chunk_bytes", 100)
    path = small_disk("6m") / "run.mcap"
    file = McapFile(path)
    channel = file.add_channel("plant/joint_state", "JointState/1", {})
    with pytest.raises(RecordingFailed, match="No space left"):
        fill(file, channel)
    with pytest.raises(RecordingFailed, match="No space left"):
        file.close()
    with Recording(path) as recording:
        steps = recording["plant/joint_state"].steps
    assert recording.damage == ""
    assert (steps == range(len(steps))).all()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary.statistics.message_count == len(summary.chunk_indexes) == len(steps)
    assert 80 * len(steps) > 600_000


def fill(file, channel):
    """Add messages until the disk is full."""
    for step in range(1_000_000):
        file.add(channel, step, encode(JointState(position=[0.0] * 10)), step)


def start(folder, *options, bytes_written=20_000):
    """Start a run of two_link; return it, with its recording, when that has grown."""
    command = [STEPBUS, "run", "two_link", *options, "--out", folder / "run"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    recording = folder / "run" / "run.mcap"
    give_up = time.monotonic() + 60
    while not recording.exists() or recording.stat().st_size < bytes_written:
        assert process.poll() is None
        assert time.monotonic() < give_up
        time.sleep(0.005)
    return process, recording


def replace(recording):
    recording.unlink()
    recording.write_bytes(b"another one's")


def overwrite(recording):
    with recording.open("r+b") as file:
        file.seek(1000)
        file.write(b"something else")


@pytest.mark.parametrize(
    "change",
    [
        lambda path: shutil.rmtree(path.parent),
        lambda path: path.rename(path.with_name("moved.mcap")),
        # Into the attachments, which are not written again, unlike what lies behind the chunks.
        lambda path: os.truncate(path, 1000),
        overwrite,
        replace,
        lambda path: path.unlink() or path.mkdir(),
        lambda path: path.unlink() or os.mkfifo(path),
        lambda path: path.unlink() or path.symlink_to("/dev/zero"),
    ],
)
def test_a_recording_changed_during_the_run_does_not_pass_as_finished(tmp_path, change):
    """The run is paused at a step while it is changed."""
    pace = Pace(50)
    options = Options(out=tmp_path / "run", extensions=[pace], host=InProcess())
    changer = Changer(lambda: change(recording), pace)
    recording = tmp_path / "run" / "run.mcap"
    result = run_scenario(load("two_link", ["duration=500ms"]), options, changer)
    assert changer.is_done
    assert f"the recording {recording} was changed or removed" in result.reason
    assert result.exit_code == ExitCode.RECORDING == 8
    if recording.parent.is_dir():
        assert json.loads((recording.parent / "result.json").read_text())["exit_code"] == 8


class Changer(Observer):
    """Changes something once a run is paused, and lets it continue."""

    def __init__(self, change, pace):
        self.is_done = False
        self.change = change
        self.pace = pace

    def progress(self, progress):
        """Change it in the first pause."""
        if progress.phase == "paused" and not self.is_done:
            self.is_done = True
            self.change()
            self.pace.resume()


def test_a_killed_orchestrator_has_recorded_what_was_complete_a_moment_before(tmp_path):
    """The first chunk is far from full at step 100, and the run stays there."""
    freeze = ["--fault", "freeze controller at 100 for 20s", "--set", "controller.step_timeout=30s"]
    process, recording = start(tmp_path, "--no-report", *freeze, bytes_written=1)
    give_up = time.monotonic() + 60
    steps = -1
    while steps < 99:
        assert time.monotonic() < give_up
        time.sleep(0.02)
        with contextlib.suppress(RecordingFailed):
            steps = Recording(recording).last_step
    process.kill()
    process.communicate()
    recovery = recover(recording, tmp_path / "whole.mcap")
    assert (recovery.last_step, recovery.holes) == (99, [])
