"""Memory that runs out while a recording is written ends it; it leaves no hole."""

import itertools
import json

import pytest
import zstandard

import stepbus
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recording, mcap_file, recover

USUAL = zstandard.ZstdCompressor


class Compressor:
    """Has no memory for one chunk, as zstandard says it."""

    def __init__(self, refuses):
        self._calls = itertools.count(1)
        self._refuses = refuses

    def __call__(self, level):
        """Return a compressor."""
        return self

    def compress(self, data):
        """Compress a chunk."""
        if next(self._calls) == self._refuses:
            raise zstandard.ZstdError("cannot compress: Allocation error : not enough memory")
        return USUAL().compress(data)


def fill(file, channel, size):
    for step in range(3000):
        file.add(channel, step, bytes(size), step)


@pytest.mark.parametrize(("size", "refuses"), [(100, 3), (70_000, 40)])
def test_a_chunk_without_memory_to_compress_it_ends_the_recording(
    tmp_path, monkeypatch, size, refuses
):
    made = Compressor(refuses)
    monkeypatch.setattr(mcap_file.zstandard, "ZstdCompressor", made)
    file = McapFile(tmp_path / "run.mcap")
    channel = file.add_channel("plant/a", "Event/1", {})
    with pytest.raises(RecordingFailed, match="no memory left"):
        fill(file, channel, size)
    with pytest.raises(RecordingFailed, match="no memory left"):
        file.close()
    with Recording(file.path) as recording:
        steps = recording["plant/a"].steps.tolist()
    assert recording.damage == ""
    assert steps
    assert steps == list(range(len(steps)))


def test_a_run_without_memory_has_a_result(tmp_path, monkeypatch):
    made = Compressor(refuses=2)
    monkeypatch.setattr(mcap_file.zstandard, "ZstdCompressor", made)
    result = stepbus.run("two_link", set={"duration": "3s"}, in_process=True, out=tmp_path / "out")
    assert (result.exit_code, "no memory left" in result.reason) == (8, True)
    assert json.loads((tmp_path / "out" / "result.json").read_text())["exit_code"] == 8
    recovery = recover(tmp_path / "out" / "run.mcap", tmp_path / "again.mcap")
    assert (recovery.holes, recovery.damage) == ([], "")
