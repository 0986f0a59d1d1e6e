"""Damages and forges recordings.

Each mutation takes a source of chance, the bytes of a recording and returns other ones.
"""

from __future__ import annotations

import io
import random
import struct
from collections.abc import Callable, Mapping
from typing import Any

from mcap.opcode import Opcode
from mcap.reader import make_reader
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


# --- bytes and records ----------------------------------------------------------------------


def _bytes(change: Callable[[random.Random, bytes], bytes], *sizes: int) -> Mutation:
    """Return a mutation that changes some bytes, of one of these sizes."""

    def mutation(chance: random.Random, data: bytes) -> bytes:
        # The first records are many and small.
        at = chance.randrange(chance.choice((len(data), min(len(data), 3000))))
        end = at + chance.choice(sizes)
        return data[:at] + change(chance, data[at:end]) + data[end:]

    return mutation


def _truncate(chance: random.Random, data: bytes) -> bytes:
    size = len(data)
    return data[: chance.choice((chance.randrange(size), size - chance.randrange(1, 200)))]


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


def _chunks(change: Callable[[random.Random, list[bytes]], None]) -> Mutation:
    """Return a mutation that changes the list of chunks, each with its message indexes."""

    def mutation(chance: random.Random, data: bytes) -> bytes:
        starts = [start for start, _ in _spans(data, Opcode.CHUNK)]
        end = max(end for _, end in _spans(data, Opcode.CHUNK, Opcode.MESSAGE_INDEX))
        bounds = zip(starts, [*starts[1:], end], strict=True)
        chunks = [data[start:stop] for start, stop in bounds]
        change(chance, chunks)
        return data[: starts[0]] + b"".join(chunks) + data[end:]

    return mutation


def _swap(chance: random.Random, chunks: list[bytes]) -> None:
    one, other = chance.sample(range(len(chunks)), 2)
    chunks[one], chunks[other] = chunks[other], chunks[one]


def _remove(chance: random.Random, chunks: list[bytes]) -> None:
    del chunks[chance.randrange(len(chunks))]


def _repeat(chance: random.Random, chunks: list[bytes]) -> None:
    at = chance.randrange(len(chunks))
    chunks.insert(at, chunks[at])


def _record(*opcodes: int) -> Mutation:
    """Return a mutation that flips a bit in a record of these kinds."""

    def mutation(chance: random.Random, data: bytes) -> bytes:
        start, end = chance.choice(_spans(data, *opcodes))
        copy = bytearray(data)
        copy[chance.randrange(start + HEAD.size, end)] ^= 1 << chance.randrange(8)
        return bytes(copy)

    return mutation


def _chunk_without_crc(chance: random.Random, data: bytes) -> bytes:
    """Change what is in a chunk, and set its checksum to 0."""
    start, end = chance.choice(_spans(data, Opcode.CHUNK))
    copy = bytearray(data)
    crc_at = start + HEAD.size + 24
    copy[crc_at : crc_at + 4] = bytes(4)
    copy[chance.randrange(crc_at + 20, end)] ^= 1 << chance.randrange(8)
    return bytes(copy)


def _no_crcs(_chance: random.Random, data: bytes) -> bytes:
    """Set every checksum to 0."""
    copy = bytearray(data)
    for _, end in _spans(data, Opcode.ATTACHMENT, Opcode.DATA_END):
        copy[end - 4 : end] = bytes(4)
    for start, _ in _spans(data, Opcode.CHUNK):
        copy[start + HEAD.size + 24 : start + HEAD.size + 28] = bytes(4)
    copy[-_CRC_IN_FOOTER:-MAGIC_BYTES] = bytes(4)
    return bytes(copy)


# --- valid files, written again -------------------------------------------------------------


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


def _copy_messages(reader: Any, writer: Any, message: Any, channel: Any) -> None:
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
        if (number := numbers[source.id]) is not None:
            for own_step, time, content in message(source.topic, item):
                writer.add_message(number, time, content, time, own_step)


def _message(change: Callable[[random.Random, int, int, bytes], Rows]) -> Mutation:
    """Return a mutation that changes one message of a participant; the hash chain stays."""

    def mutation(chance: random.Random, data: bytes) -> bytes:
        rows = [(row.topic, row.step) for row in parse(data).rows if row.topic != CHAIN]
        victim = chance.choice(rows)

        def changed(topic: str, message: Message) -> Rows:
            (row,) = _same(topic, message)
            return change(chance, *row) if (topic, message.sequence) == victim else [row]

        return _copy(data, message=changed)

    return mutation


def _changed(chance: random.Random, step: int, time: int, content: bytes) -> Rows:
    at = chance.randrange(len(content))
    return [(step, time, content[:at] + bytes((content[at] ^ 1,)) + content[at + 1 :])]


def _moved(chance: random.Random, step: int, time: int, content: bytes) -> Rows:
    other = chance.choice((0, 7, 2**32 - 1))
    return [(other + (other == step), time, content)]


def _spoilt(chance: random.Random, text: str, *others: str) -> str:
    """Return a text, one time in three something else."""
    return text if chance.random() < 0.7 else chance.choice(("", "null", "{", text[1:], *others))


def _channels(chance: random.Random, data: bytes) -> bytes:
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


def _attachments(chance: random.Random, data: bytes) -> bytes:
    """Change a line of some attachments, or leave them out."""

    def attachment(_name: str, content: bytes) -> bytes | None:
        lines = content.decode().splitlines()
        at = chance.randrange(len(lines))
        lines[at] = _spoilt(chance, lines[at], "participants: 3", "  - x", lines[-1], "\ufffd")
        return "\n".join(lines).encode() if chance.random() < 0.9 else None

    return _copy(data, attachment=attachment)


DAMAGE: Mapping[str, Mutation] = {
    "a bit flipped": _bytes(lambda chance, part: bytes((part[0] ^ 1 << chance.randrange(8),)), 1),
    "bytes overwritten": _bytes(
        lambda chance, part: chance.choice((bytes(len(part)), chance.randbytes(len(part)))),
        1, 4, 8, 100, 4096,
    ),
    "bytes inserted or repeated": _bytes(
        lambda chance, part: chance.choice((chance.randbytes(len(part)), part)) + part, 1, 8, 400
    ),
    "bytes removed": _bytes(lambda _chance, _part: b"", 1, 8, 400),
    "end cut off": _truncate,
    "chunks swapped": _chunks(_swap),
    "chunk removed": _chunks(_remove),
    "chunk repeated": _chunks(_repeat),
    "chunk changed, without a checksum": _chunk_without_crc,
    "no checksums": _no_crcs,
    "metadata changed": _record(Opcode.METADATA, Opcode.HEADER),
    "message index changed": _record(Opcode.MESSAGE_INDEX),
}  # fmt: skip
"""Not what was written: a reader that calls such a file undamaged is wrong."""

FORGED: Mapping[str, Mutation] = {
    "message dropped": _message(lambda _chance, *_row: []),
    "message changed": _message(_changed),
    "message moved": _message(_moved),
    "message repeated": _message(lambda _chance, *row: [row, row]),
}
"""Valid files whose hash chain shows that something is wrong."""

OTHER: Mapping[str, Mutation] = {
    "rewritten": lambda _chance, data: _copy(data),
    "channels changed": _channels,
    "attachments changed": _attachments,
    "metadata dropped": lambda chance, data: _copy(
        data, metadata=lambda content: chance.choice((None, {}, content))
    ),
}
"""Valid files: other recordings, not damaged ones."""

MUTATIONS: Mapping[str, Mutation] = {**DAMAGE, **FORGED, **OTHER}
