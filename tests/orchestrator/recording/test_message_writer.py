"""Our shorter way of writing messages gives the bytes of the mcap package."""

import random
from io import BytesIO

import pytest
from mcap.opcode import Opcode
from mcap.records import Message
from mcap.writer import CompressionType, Writer
from support.messages.recordings import chunks

from stepbus_orchestrator.recording.message_writer import MessageWriter
from stepbus_orchestrator.recording.records import records_of


def written(writer_class, messages, compression=CompressionType.ZSTD, chunk_size=2000):
    stream = BytesIO()
    more = {"enable_data_crcs": True} if writer_class is Writer else {}
    writer = writer_class(stream, chunk_size=chunk_size, compression=compression, **more)
    writer.start(profile="", library="stepbus")
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channels = [writer.register_channel(f"topic{n}", "msgpack", schema, {}) for n in range(3)]
    writer.add_attachment(0, 0, "a", "text/plain", b"x")
    for number, log_time, data in messages:
        writer.add_message(channels[number], log_time, data, log_time, sequence=log_time % 7)
    writer.finish()
    return stream.getvalue()


def messages(seed, count):
    chance = random.Random(seed)
    return [
        (chance.randrange(3), chance.randrange(10**12), chance.randbytes(chance.randrange(300)))
        for _ in range(count)
    ]


@pytest.mark.parametrize("count", [0, 1, 2, 50, 500])
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_the_bytes_are_those_of_the_mcap_package(count, compression):
    given = messages(count, count)
    assert written(MessageWriter, given, compression) == written(Writer, given, compression)


def test_a_message_larger_than_a_chunk_is_written_as_the_package_does():
    given = [(0, 5, b"x" * 10_000), (1, 6, b""), (0, 7, b"y")]
    assert written(MessageWriter, given) == written(Writer, given)


def test_a_chunk_ends_between_steps():
    stream = BytesIO()
    writer = MessageWriter(stream, chunk_size=2000, compression=CompressionType.ZSTD)
    writer.start()
    channels = [writer.register_channel(f"topic{n}", "msgpack", 0, {}) for n in range(3)]
    chance = random.Random(5)
    for step in range(300):
        for channel in channels:
            writer.add_message(channel, step * 10, chance.randbytes(chance.randrange(300)), 0, step)
    writer.finish()
    data = stream.getvalue()
    ends = [steps_of(data[offset : offset + length]) for offset, length in chunks(data)]
    assert len(ends) > 20
    assert [step for steps in ends for step in sorted(set(steps))] == list(range(300))


def steps_of(chunk):
    """Return the steps of the messages in a chunk."""
    records = records_of(Opcode.CHUNK, chunk[9:])
    return [record.sequence for record in records if isinstance(record, Message)]
