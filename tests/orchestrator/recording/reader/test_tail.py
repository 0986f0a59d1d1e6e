"""Following a recording while it is written."""

import pytest

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Tail, layout
from stepbus_schemas import TextMessage, encode

TEXT = "x" * 300


@pytest.fixture
def file(tmp_path):
    file = McapFile(tmp_path / layout.RUN_FILE)
    file.attach(layout.SCENARIO_ATTACHMENT, b"name: a")
    yield file
    file.close()


def write(file, channel, steps):
    for step in steps:
        data = encode(TextMessage(text=f"{step} {TEXT}"))
        file.add(channel, step * 1_000_000, data, step)


def channel_of(file):
    return file.add_channel("a/text", "Text/1", layout.channel_metadata("a", "text", "{}"))


def steps_in(tail):
    return [step for step, _ in tail.take_kept("a/text")]


def test_each_message_is_taken_once_however_chunks_and_flushes_fall(file):
    tail, channel, found = Tail(file.path), channel_of(file), []
    tail.keep(["a/text"])
    for start in range(0, 1500, 37):
        write(file, channel, range(start, start + 37))
        file.flush()
        tail.poll()
        found += steps_in(tail)
        assert found == list(range(start + 37))
        assert tail.latest("a/text")[0] == start + 36
    write(file, channel, range(1517, 1600))
    file.close()
    tail.poll()
    assert found + steps_in(tail) == [*range(1517), *range(1517, 1600)]
    assert tail.is_complete


def test_a_chunk_that_is_not_whole_yet_is_taken_when_it_is(file):
    channel = channel_of(file)
    write(file, channel, range(400))
    file.close()
    data = file.path.read_bytes()
    for end in (9, 300, len(data) // 2):
        file.path.write_bytes(data[:end])
        tail = Tail(file.path)
        tail.keep(["a/text"])
        tail.poll()
        part = steps_in(tail)
        file.path.write_bytes(data)
        tail.poll()
        assert part + steps_in(tail) == list(range(400))


def test_a_file_that_is_not_there_gives_a_sentence(tmp_path):
    with pytest.raises(RecordingFailed, match="cannot be read: No such file"):
        Tail(tmp_path / "run.mcap")
