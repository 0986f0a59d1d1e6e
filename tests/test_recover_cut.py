"""A recording cut off anywhere gives back every record that is whole."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_support import attachments, messages, metadata, opcodes, record_ends

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recover import recover

CHUNK = 0x06


@pytest.fixture(scope="session")
def chunked(two_link_recording, tmp_path_factory):
    """Return the recording again, with so many chunks that cuts fall between them."""
    return rewrite(two_link_recording, tmp_path_factory.mktemp("chunked") / "run.mcap", 4096)


def rewrite(source, target, chunk_bytes, **options):
    """Copy a recording with chunks of another size."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    with source.open("rb") as file, target.open("wb") as out:
        reader = make_reader(file)
        writer = Writer(out, chunk_size=chunk_bytes, **options)
        writer.start(profile="", library="stepbus")
        for item in reader.iter_attachments():
            writer.add_attachment(0, 0, item.name, item.media_type, item.data)
        for item in reader.iter_metadata():
            writer.add_metadata(item.name, item.metadata)
        numbers = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in numbers:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                numbers[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()
    return target
