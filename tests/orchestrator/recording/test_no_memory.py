"""Memory that runs out while a recording is written ends it; it leaves no hole."""

import itertools
import json
from io import BytesIO

import pytest
import zstandard
from mcap.reader import make_reader

import stepbus
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recorder, Recording, chunk, recover
from stepbus_orchestrator.recording.message_writer import MessageWriter
from stepbus_orchestrator.recording.workers import Workers
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import JointState, Outputs, encode

SPEC = ParticipantSpec(
    name="plant",
    participant="plant.py:Plant",
    outputs={"joint_state": OutputSpec(type="JointState/1")},
)


class Compressor:
    """Has no memory for one chunk, as zstandard says it."""

    def __init__(self, refuses):
        self._calls = itertools.count(1)
        self._refuses = refuses

    def compress(self, data):
        """Compress a chunk."""
        if next(self._calls) == self._refuses:
            raise zstandard.ZstdError("cannot compress: Allocation error : not enough memory")
        return zstandard.ZstdCompressor().compress(data)


@pytest.fixture
def compressor(monkeypatch):
    made = Compressor(refuses=3)
    monkeypatch.setattr(chunk, "_compressor", lambda *, is_big: made)


def fill(file, channel, size):
    for step in range(3000):
        file.add(channel, step, bytes(size), step)


@pytest.mark.parametrize("size", [100, 70_000])
def test_a_chunk_without_memory_to_compress_it_ends_the_recording(tmp_path, compressor, size):
    file = McapFile(tmp_path / "run.mcap")
    channel = file.add_channel("plant/a", "Event/1", {})
    with pytest.raises(RecordingFailed, match="no memory left"):
        fill(file, channel, size)
    file.close()
    with Recording(file.path) as recording:
        steps = recording["plant/a"].steps.tolist()
    assert recording.damage == ""
    assert steps
    assert steps == list(range(len(steps)))


def test_a_chunk_is_kept_until_it_is_encoded(tmp_path, compressor):
    stream, refusals = BytesIO(), 0
    writer = MessageWriter(stream, chunk_size=1000)
    for step in range(100):
        try:
            writer.add_messages([(1, bytes(100))], step, step, step)
        except MemoryError:
            refusals += 1
            writer.add_messages([(1, bytes(100))], step, step, step)
    writer.finish()
    stream.seek(0)
    summary = make_reader(stream).get_summary()
    assert (refusals, summary.statistics.message_count) == (1, 100)


def test_outputs_lost_for_lack_of_memory_have_none_behind_them(tmp_path, monkeypatch):
    file = McapFile(tmp_path / "run.mcap")
    recorder = Recorder(file, [SPEC], 1)
    recorder.open_channels({}, {})
    take = recorder.take

    def taken(step):
        published = list(take(step))
        if step == 50:
            raise MemoryError
        return published

    monkeypatch.setattr(recorder, "take", taken)
    for step in range(100):
        ports = {"joint_state": encode(JointState(position=[0.0]))}
        recorder.offer("plant", Outputs(token="", step=step, t_ns=step, ports=ports, bulk={}))
    with pytest.raises(RecordingFailed, match="no memory left"):
        recorder.write_below(100)
    with pytest.raises(RecordingFailed, match="no memory left"):
        recorder.abort()
    assert Recording(file.path).last_step < 50


def test_a_run_without_memory_has_a_result(tmp_path, monkeypatch):
    made = Compressor(refuses=2)
    monkeypatch.setattr(chunk, "_compressor", lambda *, is_big: made)
    result = stepbus.run("two_link", set={"duration": "3s"}, in_process=True, out=tmp_path / "out")
    assert (result.exit_code, "no memory left" in result.reason) == (8, True)
    assert json.loads((tmp_path / "out" / "result.json").read_text())["exit_code"] == 8
    recovery = recover(tmp_path / "out" / "run.mcap", tmp_path / "again.mcap")
    assert (recovery.holes, recovery.damage) == ([], "")


def test_without_a_further_thread_the_work_is_done_all_the_same(monkeypatch):
    def start(_thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("threading.Thread.start", start)
    taken = []
    workers = Workers(taken.append)
    for number in range(10):
        workers.give(lambda number=number: number, 2**20)
    workers.drain()
    workers.close()
    assert taken == list(range(10))
