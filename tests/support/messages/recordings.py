"""Writes, cuts, damages and compares recordings."""

import struct
from functools import partial
from itertools import pairwise

import msgspec
from mcap.reader import make_reader
from mcap.writer import Writer

from stepbus_orchestrator.recording import McapFile
from stepbus_orchestrator.recording.layout import channel_metadata, topic_of
from stepbus_schemas import SHIPPED, Description, encode, json_schema

MAGIC_BYTES = 8
HEAD = struct.Struct("<BQ")


def write(path, step_ns=10_000_000, types=SHIPPED, **ports):
    """Write a recording of participant `plant`; ports: name → type, description, messages.

    Each port has one message a step; None for a step without.
    """
    file, rows = McapFile(path), []
    for name, (type_name, description, content) in ports.items():
        names_only = not isinstance(description, Description)
        full = Description(names=description) if names_only else description
        text = msgspec.json.encode(full).decode()
        metadata = channel_metadata("plant", name, text)
        schema_of = partial(json_schema, types=types)
        channel = file.add_channel(topic_of("plant", name), type_name, metadata, schema_of)
        rows += [(step, channel, m) for step, m in enumerate(content) if m is not None]
    for step, channel, message in sorted(rows, key=lambda row: row[:2]):
        file.add(channel, step * step_ns, encode(message), step)
    file.close()
    return path


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
    """Return the type of each record of a whole file."""
    return [data[end] for end in record_ends(data)[:-1]]


def rewrite(
    source,
    target,
    chunk_bytes,
    lacks=lambda _topic, _step: False,
    library="another",
    attached=(),
    noted=None,
    **options,
):
    """Copy a recording as another program would, with chunks of another size and other options.

    library: which wrote it, as its header says. attached: names of further attachments. noted: further metadata. lacks: takes topic and step of a message; returns whether to leave it out.
    """
    with source.open("rb") as file, target.open("wb") as out:
        reader = make_reader(file)
        writer = Writer(out, chunk_size=chunk_bytes, **options)
        writer.start(profile="", library=library)
        for item in reader.iter_attachments():
            writer.add_attachment(0, 0, item.name, item.media_type, item.data)
        for name in attached:
            writer.add_attachment(0, 0, name, "text/plain", b"x")
        for item in reader.iter_metadata():
            writer.add_metadata(item.name, item.metadata)
        for name, content in (noted or {}).items():
            writer.add_metadata(name, content)
        numbers = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in numbers:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            if lacks(channel.topic, message.sequence):
                continue
            time = message.log_time
            writer.add_message(numbers[channel.id], time, message.data, time, message.sequence)
        writer.finish()
    return target


def chunks(data):
    """Return (offset, length) of each chunk of a whole file, its head included."""
    ends = record_ends(data)
    return [(a, b - a) for a, b in pairwise(ends) if data[a] == 0x06]
