"""Chunks that a thread writes: the same bytes, and the same failures, as without it."""

import errno
import os
import random
import threading

import pytest

import stepbus
from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recording, recover
from stepbus_orchestrator.recording.background import Background


def fill(path, *, in_background, flush_every=10**9):
    """Write some chunks of random content, with metadata in between."""
    chance, file = random.Random(1), McapFile(path, in_background=in_background)
    channel = file.add_channel("plant/a", "Event/1", {})
    for step in range(2000):
        file.add(channel, step, chance.randbytes(chance.randrange(400)), step)
        if step % flush_every == 0:
            file.flush()
        if step % 500 == 250:
            file.add_metadata("in the midst", {"step": str(step)})
    file.close()
    file.check()
    return path.read_bytes()


@pytest.mark.parametrize("flush_every", [10**9, 7])
def test_a_thread_writes_the_same_bytes(tmp_path, flush_every):
    usual = fill(tmp_path / "usual.mcap", in_background=False)
    assert fill(tmp_path / "a.mcap", in_background=True, flush_every=flush_every) == usual


def test_a_machine_without_a_thread_to_spare_writes_the_same_bytes(tmp_path, monkeypatch):
    usual = fill(tmp_path / "usual.mcap", in_background=False)
    monkeypatch.setattr(threading, "_start_new_thread", _no_thread)
    assert fill(tmp_path / "a.mcap", in_background=True) == usual


def _no_thread(*_given):
    raise RuntimeError("can't start new thread")


def test_the_thread_starts_with_the_second_full_chunk_and_ends_with_the_file(tmp_path):
    file = McapFile(tmp_path / "run.mcap", in_background=True)
    channel, before = file.add_channel("plant/a", "Event/1", {}), threading.active_count()
    counts = []
    for step in range(4):
        file.add(channel, step, bytes(10**5), step)
        counts.append(threading.active_count() - before)
    file.close()
    assert (counts, threading.active_count()) == ([0, 0, 1, 1], before)


def refusing(room):
    """Return a `pwritev` for so many bytes."""
    left, write = [room], os.pwritev

    def pwritev(fd, parts, offset):
        left[0] -= sum(map(len, parts))
        if left[0] < 0 and threading.current_thread() is not threading.main_thread():
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(fd, parts, offset)

    return pwritev


def test_a_full_disk_that_the_thread_finds_ends_a_run_whose_recording_has_no_hole(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(os, "pwritev", refusing(100_000))
    result = stepbus.run("two_link", set={"duration": "10s"}, in_process=True, out=tmp_path / "out")
    assert (result.exit_code, "No space left on device" in result.reason) == (
        ExitCode.RECORDING,
        True,
    )
    with Recording(result.recording) as recording:
        assert recording.damage == ""
        assert len(recording["plant.joint_state"].steps) > 100
    assert recover(result.recording, tmp_path / "fixed.mcap").holes == []


def test_a_write_that_fails_last_of_all_is_not_lost(tmp_path, monkeypatch):
    file = McapFile(tmp_path / "run.mcap", in_background=True)
    channel = file.add_channel("plant/a", "Event/1", {})
    for step in range(2):
        file.add(channel, step, bytes(10**5), step)
    monkeypatch.setattr(os, "pwritev", refusing(0))
    file.add(channel, 2, b"", 2)
    with pytest.raises(RecordingFailed, match="No space left on device"):
        file.close()
    with Recording(file.path) as recording:
        assert recording.damage == ""
        assert recording["plant/a"].steps.tolist() == [0]


def test_what_a_call_raises_is_raised_once_by_the_next():
    background = Background(has_thread=True)
    background.start(lambda: next(iter(())))
    with pytest.raises(StopIteration):
        background.start(lambda: None)
    background.start(lambda: {}[1])
    with pytest.raises(KeyError):
        background.settle()
    background.settle()
    background.end()
    background.end()
