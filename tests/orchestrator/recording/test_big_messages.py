"""Big messages are compressed faster, or not at all; they are recorded like all others."""

import contextlib
import errno
import os
import random
import shutil

import pytest
from mcap.reader import make_reader
from support.messages.recordings import messages

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recorder, Recording, layout, recover
from stepbus_orchestrator.recording.reader.tail import Tail
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import Image, JointState, Outputs, encode

STEPS, STEP_NS = 70, 5_000_000
SPEC = ParticipantSpec(
    name="plant",
    participant="plant.py:Plant",
    outputs={
        "joint_state": OutputSpec(type="JointState/1"),
        "image": OutputSpec(type="Image/1", bulk=True),
    },
)


def pictures():
    """Return the content of every third step: noise, something smooth, something small."""
    chance, content = random.Random(2), {}
    for step in range(0, STEPS, 3):
        size = 300 if step % 4 == 1 else 70_200 + 30 * step
        data = bytes(size) if step % 2 else chance.randbytes(size)
        image = Image(
            width=1,
            height=size // 3,
            encoding="rgb8",
            data=data,
            focal=(1.0, 1.0),
            centre=(0.0, 0.0),
        )
        content[step] = encode(image)
    return content


def record(path, flush_at=(), seen=lambda _step: None):
    """Record pictures and states; flush behind some steps."""
    file, big = McapFile(path), pictures()
    recorder = Recorder(file, [SPEC], STEP_NS)
    recorder.open_channels({}, {})
    try:
        for step in range(STEPS):
            bulk = {"image": len(big[step])} if step in big else {}
            if bulk:
                recorder.offer_bulk("plant", "image", step, big[step])
            ports = {"joint_state": encode(JointState(position=[0.1 * step]))}
            outputs = Outputs(token="", step=step, t_ns=step * STEP_NS, ports=ports, bulk=bulk)
            recorder.offer("plant", outputs)
            recorder.write_below(step + 1)
            if step in flush_at:
                recorder.flush()
                seen(step)
        recorder.finish(STEPS, ())
    finally:
        with contextlib.suppress(RecordingFailed):
            recorder.abort()
    file.check()
    return recorder.messages_sha256


def test_every_reader_reads_it_and_a_recovery_gives_its_bytes(tmp_path):
    path = tmp_path / layout.RUN_FILE
    record(path)
    recording, big = Recording(path), pictures()
    assert recording.flaws() == []
    assert {e.step: e.data for e in recording["plant/image"].entries()} == big
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        kinds = {chunk.compression for chunk in reader.get_summary().chunk_indexes}
        rows = [item.data for _, channel, item in reader.iter_messages(["plant/image"])]
    assert kinds == {"zstd", ""}
    assert rows == list(big.values())
    tail = Tail(path)
    tail.keep(["plant/image"])
    tail.poll()
    assert tail.take_kept("plant/image") == list(big.items())
    recovery = recover(path, tmp_path / "again.mcap")
    assert (recovery.holes, recovery.damage) == ([], "")
    assert recovery.target.read_bytes() == path.read_bytes()


def test_all_that_was_flushed_is_there_after_a_kill(tmp_path):
    """It is there whole, for one who follows it too."""
    path, found = tmp_path / layout.RUN_FILE, {}
    tail = None

    def look(step):
        nonlocal tail
        tail = tail or Tail(path)
        tail.poll()
        copied = shutil.copy(path, tmp_path / "cut.mcap")
        with Recording(copied) as recording:
            found[step] = (recording.last_step, tail.last_step, recording.flaws()[1:])

    record(path, range(0, STEPS, 2), look)
    assert found == {step: (step, step, []) for step in found}


@pytest.mark.parametrize(("lasting", "flush"), [(True, True), (True, False), (False, False)])
@pytest.mark.parametrize("nth", [3, 8, 12])
def test_after_the_first_write_that_fails_only_the_index_is_written(
    tmp_path, monkeypatch, lasting, flush, nth
):
    path, calls, write = tmp_path / "run.mcap", [], os.pwritev

    def pwritev(file, parts, offset):
        if sum(map(len, parts)) > 10_000:
            calls.append(len(parts))
            if len(calls) == nth or (lasting and len(calls) > nth):
                raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, parts, offset)

    monkeypatch.setattr("os.pwritev", pwritev)
    with pytest.raises(RecordingFailed, match="No space left"):
        record(path, range(0, STEPS, 7) if flush else ())
    monkeypatch.undo()
    before = messages(path)
    whole = tmp_path / "whole.mcap"
    record(whole)
    assert 0 < len(before) < len(messages(whole))
    assert before == messages(whole)[: len(before)]
    with Recording(path) as recording:
        assert recording.damage == ""
        states, images = recording["plant/joint_state"].steps, recording["plant/image"].steps
        assert images.tolist() == [step for step in pictures() if step <= states[-1]]


def test_the_bytes_do_not_depend_on_the_clock(tmp_path):
    found = set()
    for flush_at in ((), range(STEPS), (5, 20, 21)):
        sha256 = record(tmp_path / "run.mcap", flush_at)
        found.add(((tmp_path / "run.mcap").read_bytes(), sha256))
    assert len(found) == 1
