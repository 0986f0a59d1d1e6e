"""Our shorter way of writing messages gives the bytes of the mcap package."""

import random
from io import BytesIO

import pytest
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

from stepbus_orchestrator.recording import McapFile


def by_the_package(given, chunk_size=2000):
    """Return what the mcap package writes."""
    stream = BytesIO()
    writer = Writer(
        stream, chunk_size=chunk_size, compression=CompressionType.ZSTD, enable_data_crcs=True
    )
    writer.start(profile="", library="stepbus")
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channels = [writer.register_channel(f"topic{n}", "msgpack", schema, {}) for n in range(3)]
    writer.add_attachment(0, 0, "a", "application/octet-stream", b"x")
    writer.add_metadata("m", {"key": "value"})
    for number, log_time, data in given:
        writer.add_message(channels[number], log_time, data, log_time, sequence=log_time % 7)
    writer.finish()
    return stream.getvalue()


@pytest.fixture
def by_us(tmp_path, monkeypatch):
    """Return a function that returns what we write."""
    monkeypatch.setattr(McapFile, "chunk_bytes", 2000)

    def write(given):
        file = McapFile(tmp_path / "run.mcap", library="stepbus")
        schema = file.register(Schema(id=0, data=b"{}", encoding="jsonschema", name="s"))
        channels = [file.register(channel(f"topic{n}", schema)) for n in range(3)]
        file.attach("a", b"x")
        file.add_metadata("m", {"key": "value"})
        for number, log_time, data in given:
            file.add(channels[number], log_time, data, log_time % 7)
        file.close()
        return file.path.read_bytes()

    return write


def channel(topic, schema):
    return Channel(id=0, topic=topic, message_encoding="msgpack", metadata={}, schema_id=schema)


def messages(seed, count):
    chance = random.Random(seed)
    return [
        (chance.randrange(3), chance.randrange(10**12), chance.randbytes(chance.randrange(300)))
        for _ in range(count)
    ]


@pytest.mark.parametrize("count", [0, 1, 2, 50, 500])
def test_the_bytes_are_those_of_the_mcap_package(by_us, count):
    given = messages(count, count)
    assert by_us(given) == by_the_package(given)


def test_a_message_larger_than_a_chunk_is_written_as_the_package_does(by_us):
    given = [(0, 5, b"x" * 10_000), (1, 6, b""), (0, 7, b"y")]
    assert by_us(given) == by_the_package(given)
