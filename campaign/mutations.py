"""Damages and forges recordings.

Each mutation takes a source of chance, the bytes of a recording and returns other ones.
"""

from __future__ import annotations

import io
import random
import struct
from collections.abc import Callable
from typing import Any

from mcap.opcode import Opcode
from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Message
from mcap.writer import Writer

from .log_reader import CHAIN, parse

MAGIC_BYTES = 8
HEAD = struct.Struct("<BQ")
_CRC_IN_FOOTER = 12  # behind it: the CRC and the magic bytes

Mutation = Callable[[random.Random, bytes], bytes]

DESCRIPTIONS = (
    "", "null", "3", "[]", '{"limits": null}', '{"limits": {"lower": null}}',
    '{"limits": {"lower": ["x"]}}', '{"names": 3}', '{"names": ["joint1"]}',
    '{"names": ["joint1", "joint1", "joint2"], "details": {"type": []}}', '{"like": "nothing"}',
    '{"like": "joint_state"}', '{"shape": ["a"]}', "{", "\ufffd",
)  # fmt: skip


def _spans(data: bytes, *opcodes: int) -> list[tuple[int, int]]:
    """Return (start, end) of each record of these kinds in a whole file."""
    spans, offset = [], MAGIC_BYTES
    while offset < len(data) - MAGIC_BYTES:
        opcode, length = HEAD.unpack_from(data, offset)
        end = offset + HEAD.size + length
        if opcode in opcodes:
            spans.append((offset, end))
        offset = end
    return spans


def _somewhere(chance: random.Random, data: bytes) -> int:
    """Return an offset; half of them lie in the first records, which are many and small."""
    end = len(data) if chance.random() < 0.5 else min(len(data), 3000)
    return chance.randrange(end)


def flip(chance: random.Random, data: bytes) -> bytes:
    """Flip one bit to eight."""
    copy = bytearray(data)
    for _ in range(chance.choice((1, 1, 1, 2, 8))):
        copy[_somewhere(chance, data)] ^= 1 << chance.randrange(8)
    return bytes(copy)


def overwrite(chance: random.Random, data: bytes) -> bytes:
    """Write zeros or nonsense over some bytes; where that is what they are, their complement."""
    at, length = _somewhere(chance, data), chance.choice((1, 4, 8, 100, 4096))
    before = data[at : at + length]
    length = len(before)
    after = chance.choice((bytes(length), chance.randbytes(length)))
    if after == before:
        after = bytes(255 - byte for byte in before)
    return data[:at] + after + data[at + length :]


def truncate(chance: random.Random, data: bytes) -> bytes:
    """Cut the end off."""
    return data[
        : chance.choice((chance.randrange(len(data)), len(data) - chance.randrange(1, 200)))
    ]


def insert(chance: random.Random, data: bytes) -> bytes:
    """Add bytes, or repeat some."""
    at, length = _somewhere(chance, data), chance.choice((1, 8, 400))
    return data[:at] + chance.choice((chance.randbytes(length), data[at : at + length])) + data[at:]


def remove(chance: random.Random, data: bytes) -> bytes:
    """Take bytes out."""
    at = _somewhere(chance, data)
    return data[:at] + data[at + chance.choice((1, 8, 400)) :]


def swap_chunks(chance: random.Random, data: bytes) -> bytes:
    """Swap two chunks, each with its message indexes."""
    first, second = sorted(chance.sample(_chunks(data), 2))
    (a, b), (c, d) = first, second
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def remove_chunk(chance: random.Random, data: bytes) -> bytes:
    """Take out a chunk."""
    start, end = chance.choice(_chunks(data))
    return data[:start] + data[end:]


def repeat_chunk(chance: random.Random, data: bytes) -> bytes:
    """Repeat a chunk right behind itself."""
    start, end = chance.choice(_chunks(data))
    return data[:end] + data[start:end] + data[end:]


def _chunks(data: bytes) -> list[tuple[int, int]]:
    """Return where each chunk lies, with the message indexes that follow it."""
    starts = [start for start, _ in _spans(data, Opcode.CHUNK)]
    ends = [end for _, end in _spans(data, Opcode.CHUNK, Opcode.MESSAGE_INDEX)]
    return [
        (start, max(end for end in ends if end <= following))
        for start, following in zip(starts, [*starts[1:], len(data)], strict=True)
    ]


def chunk_without_crc(chance: random.Random, data: bytes) -> bytes:
    """Change what is in a chunk, and set its checksum to 0."""
    start, end = chance.choice(_spans(data, Opcode.CHUNK))
    copy = bytearray(data)
    crc_at = start + HEAD.size + 24
    copy[crc_at : crc_at + 4] = bytes(4)
    copy[chance.randrange(crc_at + 20, end)] ^= 1 << chance.randrange(8)
    return bytes(copy)


def no_crcs(_chance: random.Random, data: bytes) -> bytes:
    """Set every checksum to 0."""
    copy = bytearray(data)
    for _, end in _spans(data, Opcode.ATTACHMENT, Opcode.DATA_END):
        copy[end - 4 : end] = bytes(4)
    for start, _ in _spans(data, Opcode.CHUNK):
        copy[start + HEAD.size + 24 : start + HEAD.size + 28] = bytes(4)
    copy[-_CRC_IN_FOOTER:-MAGIC_BYTES] = bytes(4)
    return bytes(copy)


def metadata_changed(chance: random.Random, data: bytes) -> bytes:
    """Change a letter of a metadata record."""
    return _flipped_in(chance, data, 1, Opcode.METADATA, Opcode.HEADER)


def message_index_changed(chance: random.Random, data: bytes) -> bytes:
    """Change an index of messages, which other programs go by."""
    return _flipped_in(chance, data, 1 << chance.randrange(8), Opcode.MESSAGE_INDEX)


def _flipped_in(chance: random.Random, data: bytes, bit: int, *opcodes: int) -> bytes:
    """Flip a bit in a record of these kinds."""
    start, end = chance.choice(_spans(data, *opcodes))
    copy = bytearray(data)
    copy[chance.randrange(start + HEAD.size, end)] ^= bit
    return bytes(copy)


Rows = list[tuple[int, int, bytes]]
"""Step, time [ns] and content of messages."""


def _same(_topic: str, message: Message) -> Rows:
    return [(message.sequence, message.log_time, message.data)]


def _unchanged(schema: Any, channel: Channel) -> tuple[str, bytes, str, dict[str, str]]:
    return schema.name, schema.data, channel.topic, channel.metadata


def _copy(
    data: bytes,
    *,
    message: Callable[[str, Message], Rows] = _same,
    channel: Callable[[Any, Channel], Any] = _unchanged,
    attachment: Callable[[str, bytes], bytes | None] = lambda _name, data: data,
    metadata: Callable[[dict[str, str]], dict[str, str] | None] = lambda content: content,
) -> bytes:
    """Return a valid file, written again from another one, with something else in it.

    message: returns what stands in the place of a message. channel: returns schema name, schema,
    topic and metadata; None leaves it out, as with `attachment` and `metadata`.
    """
    out, reader = io.BytesIO(), make_reader(io.BytesIO(data))
    writer: Any = Writer(out, enable_data_crcs=True)
    header = reader.get_header()
    writer.start(profile=header.profile, library=header.library)
    for item in reader.iter_attachments():
        if (content := attachment(item.name, item.data)) is not None:
            writer.add_attachment(0, 0, item.name, item.media_type, content)
    for record in reader.iter_metadata():
        if (text := metadata(record.metadata)) is not None:
            writer.add_metadata(record.name, text)
    _copy_messages(reader, writer, message, channel)
    writer.finish()
    return out.getvalue()


def _copy_messages(reader: McapReader, writer: Any, message: Any, channel: Any) -> None:
    numbers: dict[int, int | None] = {}
    step = 0
    for schema, source, item in reader.iter_messages(log_time_order=False):
        if item.sequence != step:
            # A chunk of ours ends with a whole step.
            writer.flush()
        step = item.sequence
        if source.id not in numbers:
            row = channel(schema, source)
            if row is not None:
                name, content, topic, about = row
                kind = writer.register_schema(name, "jsonschema", content)
                row = writer.register_channel(topic, source.message_encoding, kind, about)
            numbers[source.id] = row
        number = numbers[source.id]
        if number is not None:
            for own_step, time, content in message(source.topic, item):
                writer.add_message(number, time, content, time, own_step)


def rewritten(_chance: random.Random, data: bytes) -> bytes:
    """Return the recording again in other chunks, with nothing changed."""
    return _copy(data)


def _one_changed(
    chance: random.Random, data: bytes, change: Callable[[int, int, bytes], Rows]
) -> bytes:
    """Change one message of a participant; the hash chain stays."""
    rows = [(row.topic, row.step) for row in parse(data).rows if row.topic != CHAIN]
    victim = chance.choice(rows)

    def changed(topic: str, message: Message) -> Rows:
        (row,) = _same(topic, message)
        return change(*row) if (topic, message.sequence) == victim else [row]

    return _copy(data, message=changed)


def message_dropped(chance: random.Random, data: bytes) -> bytes:
    """Leave one message out."""
    return _one_changed(chance, data, lambda *_row: [])


def message_changed(chance: random.Random, data: bytes) -> bytes:
    """Change one message."""

    def changed(step: int, time: int, content: bytes) -> Rows:
        at = chance.randrange(len(content))
        return [(step, time, content[:at] + bytes((content[at] ^ 1,)) + content[at + 1 :])]

    return _one_changed(chance, data, changed)


def message_moved(chance: random.Random, data: bytes) -> bytes:
    """Give one message another step."""
    other = chance.choice((0, 7, 2**32 - 1))
    return _one_changed(
        chance, data, lambda step, time, content: [(other + (other == step), time, content)]
    )


def message_repeated(chance: random.Random, data: bytes) -> bytes:
    """Write one message twice."""
    return _one_changed(chance, data, lambda *row: [row, row])


def _spoilt(chance: random.Random, text: str, *others: str) -> str:
    """Return a text, one time in three something else."""
    return text if chance.random() < 0.7 else chance.choice(("", "null", "{", text[1:], *others))


def channel_changed(chance: random.Random, data: bytes) -> bytes:
    """Change topic, type or description of some channels, or leave them out."""

    def channel(schema: Any, channel: Any) -> Any:
        if chance.random() < 0.1:
            return None
        name = _spoilt(chance, schema.name, "stepbus.", "stepbus.JointState/1", "stepbus.Later/9")
        topic = _spoilt(chance, channel.topic, "/", "a/b/c", "plant/joint_state", CHAIN)
        about = {
            key: _spoilt(chance, text, *DESCRIPTIONS) for key, text in channel.metadata.items()
        }
        return name, _spoilt(chance, schema.data.decode()).encode(), topic, about

    return _copy(data, channel=channel)


def attachment_changed(chance: random.Random, data: bytes) -> bytes:
    """Change a line of some attachments, or leave them out."""

    def attachment(_name: str, content: bytes) -> bytes | None:
        lines = content.decode().splitlines()
        at = chance.randrange(len(lines))
        lines[at] = _spoilt(chance, lines[at], "participants: 3", "  - x", lines[-1], "\ufffd")
        return "\n".join(lines).encode() if chance.random() < 0.9 else None

    return _copy(data, attachment=attachment)


def metadata_dropped(chance: random.Random, data: bytes) -> bytes:
    """Leave metadata records out, or empty them."""
    return _copy(data, metadata=lambda content: chance.choice((None, {}, content)))


DAMAGE: tuple[Mutation, ...] = (
    flip, overwrite, truncate, insert, remove, swap_chunks, remove_chunk, repeat_chunk,
    chunk_without_crc, no_crcs, metadata_changed, message_index_changed,
)  # fmt: skip
"""Not what was written: a reader that calls such a file undamaged is wrong."""

FORGED: tuple[Mutation, ...] = (
    message_dropped, message_changed, message_moved, message_repeated,
)  # fmt: skip
"""Valid files whose hash chain shows that something is wrong."""

OTHER: tuple[Mutation, ...] = (
    rewritten, channel_changed, attachment_changed, metadata_dropped,
)  # fmt: skip
"""Valid files: other recordings, not damaged ones."""

MUTATIONS = (*DAMAGE, *FORGED, *OTHER)
