"""What a killed orchestrator leaves behind, and that it changes no byte of a closed recording."""

import errno
import os
import random
import shutil

import pytest
from support.messages.recordings import messages

from stepbus_orchestrator.recording import McapFile, Recording, recover


def fill(path, flush_at, seen=lambda _count: None):
    """Write 2000 messages of random content; flush before those in `flush_at`."""
    chance, file = random.Random(1), McapFile(path)
    channels = [file.add_channel(f"plant/{port}", "Event/1", {}) for port in "ab"]
    for step in range(1000):
        for number, channel in enumerate(channels):
            if 2 * step + number in flush_at:
                file.flush()
                seen(2 * step + number)
            file.add(channel, step, chance.randbytes(chance.randrange(300)), step)
        if step == 500:
            file.add_metadata("in the midst", {})
    file.close()
    file.check()
    return path


@pytest.mark.parametrize("every", [1, 2, 7, 100, 333])
def test_flushing_changes_no_byte_of_the_closed_file(tmp_path, every):
    plain = fill(tmp_path / "plain.mcap", ())
    flushed = fill(tmp_path / "flushed.mcap", range(0, 2000, every))
    assert flushed.read_bytes() == plain.read_bytes()


def test_all_that_was_flushed_can_be_recovered(tmp_path):
    path, counts = tmp_path / "run.mcap", {}

    def copy(count):
        copied = shutil.copy(path, tmp_path / "cut.mcap")
        counts[count] = recover(copied, tmp_path / "fixed.mcap", in_place=True).messages
        assert sum(len(port) for port in Recording(copied).ports.values()) == counts[count]

    fill(path, range(0, 2000, 102), copy)
    assert counts == {count: count for count in range(0, 2000, 102)}


def test_metadata_between_two_flushes_takes_nothing_from_the_file(tmp_path):
    file = McapFile(tmp_path / "run.mcap")
    channel = file.add_channel("plant/a", "Event/1", {})
    for step in range(60):
        file.add(channel, step, b"", step)
        if step in (10, 20):
            file.flush()
        if step == 30:
            file.add_metadata("on_fault", {"participant": "mission"})
            assert Recording(file.path)["plant/a"].steps.tolist() == list(range(21))
    file.flush()
    assert Recording(file.path)["plant/a"].steps.tolist() == list(range(60))
    file.close()
    file.check()


def test_a_flush_that_finds_no_room_is_made_up_for_by_the_next_one(tmp_path, monkeypatch):
    def refuse(*_args):
        raise OSError(errno.ENOSPC, "No space left on device")

    file = McapFile(tmp_path / "run.mcap")
    channel = file.add_channel("plant/a", "Event/1", {})
    for step in range(60):
        file.add(channel, step, b"", step)
        with monkeypatch.context() as patch:
            if 20 <= step < 40:
                patch.setattr("os.pwritev", refuse)
            file.flush()
    assert Recording(file.path)["plant/a"].steps.tolist() == list(range(60))
    file.close()


def test_a_kill_between_a_chunk_and_the_cut_behind_it_leaves_no_rubbish(tmp_path, monkeypatch):
    path, copies = tmp_path / "run.mcap", []

    def copy(file, length):
        copies.append(shutil.copy(path, tmp_path / f"cut{len(copies)}.mcap"))
        truncate(file, length)

    truncate = os.ftruncate
    monkeypatch.setattr("os.ftruncate", copy)
    whole = messages(fill(path, range(0, 2000, 10)))
    assert len(copies) > 3
    for number, copied in enumerate(copies):
        found = messages(recover(copied, tmp_path / f"fixed{number}.mcap").target)
        assert found == whole[: len(found)]
        assert len(found) > 100


def test_what_a_torn_chunk_leaves_behind_it_is_not_returned_twice(tmp_path, monkeypatch):
    """A failing power supply tears the write of a chunk where an older record begins."""
    path, copies = tmp_path / "run.mcap", []
    truncate = os.ftruncate

    def copy(file, length):
        copies.append((path.read_bytes(), length, ahead[-1]))
        truncate(file, length)

    whole = messages(fill(path, ()))
    monkeypatch.setattr("os.ftruncate", copy)
    ahead = []
    fill(path, range(0, 2000, 10), lambda _count: ahead.append(path.read_bytes()))
    torn, length, before = copies[1]
    edges = [at for at in range(length, len(before)) if before.startswith(b"\x05", at)]
    path.write_bytes(torn[:length])
    kept = len(messages(recover(path, tmp_path / "kept.mcap").target))
    cut = 0
    for edge in edges:
        path.write_bytes(torn[:length] + before[edge:])
        recovery = recover(path, tmp_path / "fixed.mcap", in_place=True)
        assert messages(recovery.target) == whole[:kept]
        cut += "the write that should replace it was" in recovery.damage
    assert cut > 2
