"""Cuts, spoils and compares recordings."""

import struct

from mcap.reader import make_reader
from mcap.writer import Writer

MAGIC_BYTES = 8
HEAD = struct.Struct("<BQ")


def messages(path):
    """Return (topic, log time, sequence, content) of all messages in the recorded order."""
    with path.open("rb") as file:
        found = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, m.log_time, m.sequence, m.data) for _, channel, m in found]


def attachments(path):
    """Return name → content."""
    with path.open("rb") as file:
        return {item.name: item.data for item in make_reader(file).iter_attachments()}


def metadata(path):
    """Return name → content."""
    with path.open("rb") as file:
        return {item.name: item.metadata for item in make_reader(file).iter_metadata()}


def record_ends(data):
    """Return where each record of a whole file ends."""
    ends = [MAGIC_BYTES]
    while ends[-1] < len(data) - MAGIC_BYTES:
        _, length = HEAD.unpack_from(data, ends[-1])
        ends.append(ends[-1] + HEAD.size + length)
    return ends


def opcodes(data):
    """Return the kind of each record of a whole file."""
    return [data[end] for end in record_ends(data)[:-1]]


def rewrite(source, target, chunk_bytes, **options):
    """Copy a recording with chunks of another size, and with other options of the writer."""
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
            time = message.log_time
            writer.add_message(numbers[channel.id], time, message.data, time, message.sequence)
        writer.finish()
    return target
