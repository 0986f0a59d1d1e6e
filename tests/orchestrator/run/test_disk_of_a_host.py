"""What a run writes goes through the disk of its host."""

import errno
import os

import pytest
from tests.support.runs.joints import run_joints

from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording import recover
from stepbus_orchestrator.run import hosts


class Disk:
    """The real one, which writes at most 7 bytes at once, and no more than `room` bytes."""

    def __init__(self, room=10**9):
        self.room = room

    def __getattr__(self, name):
        return getattr(os, name)

    def pwritev(self, fd, parts, offset):
        data = b"".join(parts)
        if len(data) > self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = os.pwritev(fd, [data[:7]], offset)
        self.room -= count
        return count


class OnDisk(hosts.InProcess):
    """One process, on a disk of the test's."""

    disk = Disk()


def test_short_writes_change_nothing(tmp_path):
    short = run_joints(tmp_path / "short", host=OnDisk())
    usual = run_joints(tmp_path / "usual", in_process=True)
    assert short.sha256 == usual.sha256


def test_a_full_disk_ends_a_run_whose_recording_has_no_hole(tmp_path, monkeypatch):
    monkeypatch.setattr(OnDisk, "disk", Disk(room=20_000))
    result = run_joints(tmp_path, host=OnDisk())
    assert result.exit_code == ExitCode.RECORDING
    assert "No space left on device" in result.reason
    assert recover(result.recording, tmp_path / "fixed.mcap").holes == []


class LateError(Disk):
    """The real one, each of whose files is closed with an error that comes late."""

    def close(self, fd):
        os.close(fd)
        raise OSError(errno.EIO, "Input/output error")


def test_an_error_at_close_does_not_stop_a_run_whose_recording_is_whole(tmp_path, monkeypatch):
    usual = run_joints(tmp_path / "usual", in_process=True)
    monkeypatch.setattr(OnDisk, "disk", LateError())
    result = run_joints(tmp_path / "late", host=OnDisk())
    assert (result.exit_code, result.sha256) == (0, usual.sha256)
    assert recover(result.recording, tmp_path / "fixed.mcap").holes == []


def test_recover_writes_to_a_disk(tmp_path):
    recording = run_joints(tmp_path, in_process=True).recording
    with pytest.raises(RecordingFailed, match="No space left on device"):
        recover(recording, tmp_path / "fixed.mcap", disk=Disk(room=100))
    assert sorted(file.name for file in tmp_path.glob("*.mcap*")) == []
    recover(recording, tmp_path / "fixed.mcap", disk=Disk())
    assert (tmp_path / "fixed.mcap").read_bytes() == recording.read_bytes()
