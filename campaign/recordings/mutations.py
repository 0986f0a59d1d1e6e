"""Damages and forges recordings.

Each mutation takes a source of chance, the bytes of a recording and returns other ones.
"""

from __future__ import annotations

import io
import json
import random
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer

from ..log_reader import CHAIN

MAGIC_BYTES = 8
HEAD = struct.Struct("<BQ")
_FOOTER_BYTES = 37  # the footer with its head, and the magic bytes
_CRC_IN_FOOTER = 12  # behind it: the CRC and the magic bytes

Mutation = Callable[[random.Random, bytes], bytes]

DESCRIPTIONS = (
    "", "null", "3", "[]", '{"limits": null}', '{"limits": {"lower": null}}',
    '{"limits": {"lower": ["x"]}}', '{"names": 3}', '{"names": ["joint1"]}',
    '{"names": ["joint1", "joint1", "joint2"], "details": {"type": []}}', '{"like": "nothing"}',
    '{"like": "joint_state"}', '{"shape": ["a"]}', "{", "\ufffd",
)  # fmt: skip


def records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) of each record of a whole file."""
    offset = MAGIC_BYTES
    while offset < len(data) - MAGIC_BYTES:
        opcode, length = HEAD.unpack_from(data, offset)
        end = offset + HEAD.size + length
        yield opcode, offset, end
        offset = end


def _spans(data: bytes, *opcodes: int) -> list[tuple[int, int]]:
    return [(start, end) for opcode, start, end in records(data) if opcode in opcodes]


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
    chunks: list[tuple[int, int]] = []
    for opcode, start, end in records(data):
        if opcode == Opcode.CHUNK:
            chunks.append((start, end))
        elif opcode == Opcode.MESSAGE_INDEX:
            chunks[-1] = (chunks[-1][0], end)
    return chunks


def chunk_without_crc(chance: random.Random, data: bytes) -> bytes:
    """Change what is in a chunk, and set its checksum to 0."""
    start, end = chance.choice(_spans(data, Opcode.CHUNK))
    copy = bytearray(data)
    crc_at = start + HEAD.size + 24
    copy[crc_at : crc_at + 4] = bytes(4)
    copy[chance.randrange(crc_at + 20, end)] ^= 1 << chance.randrange(8)
    return bytes(copy)


def no_crcs(_chance: random.Random, data: bytes) -> bytes:
    """Set every checksum to 0, and change a metadata record or an attachment."""
    copy = bytearray(data)
    for opcode, start, end in records(data):
        if opcode in {Opcode.ATTACHMENT, Opcode.DATA_END}:
            copy[end - 4 : end] = bytes(4)
        if opcode == Opcode.CHUNK:
            copy[start + HEAD.size + 24 : start + HEAD.size + 28] = bytes(4)
    copy[-_CRC_IN_FOOTER:-MAGIC_BYTES] = bytes(4)
    return bytes(copy)


def metadata_changed(chance: random.Random, data: bytes) -> bytes:
    """Change a letter of a metadata record."""
    start, end = chance.choice(_spans(data, Opcode.METADATA, Opcode.HEADER))
    copy = bytearray(data)
    copy[chance.randrange(start + HEAD.size, end)] ^= 1
    return bytes(copy)


def message_index_changed(chance: random.Random, data: bytes) -> bytes:
    """Change an index of messages, which other programs go by."""
    start, end = chance.choice(_spans(data, Opcode.MESSAGE_INDEX))
    copy = bytearray(data)
    copy[chance.randrange(start + HEAD.size, end)] ^= 1 << chance.randrange(8)
    return bytes(copy)


@dataclass
class Copy:
    """A valid file, written again from another one, with something else in it.

    Each hook returns what is to be written; None to leave it out.
    """

    message: Callable[[Any, Any], list[tuple[int, int, bytes]]] = field(
        default=lambda _channel, m: [(m.sequence, m.log_time, m.data)]
    )
    channel: Callable[[Any, Any], Any] = field(
        default=lambda schema, channel: (schema.name, schema.data, channel.topic, channel.metadata)
    )
    attachment: Callable[[str, bytes], bytes | None] = field(default=lambda _name, data: data)
    metadata: Callable[[str, dict[str, str]], dict[str, str] | None] = field(
        default=lambda _name, content: content
    )

    def of(self, data: bytes) -> bytes:
        """Return the bytes of the copy."""
        out, reader = io.BytesIO(), make_reader(io.BytesIO(data))
        header = reader.get_header()
        writer: Any = Writer(out, enable_data_crcs=True)
        writer.start(profile=header.profile, library=header.library)
        for item in reader.iter_attachments():
            content = self.attachment(item.name, item.data)
            if content is not None:
                writer.add_attachment(0, 0, item.name, item.media_type, content)
        for record in reader.iter_metadata():
            text = self.metadata(record.name, record.metadata)
            if text is not None:
                writer.add_metadata(record.name, text)
        numbers: dict[int, int | None] = {}
        step = 0
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if message.sequence != step:
                # A chunk of ours ends with a whole step.
                writer.flush()
            step = message.sequence
            if channel.id not in numbers:
                numbers[channel.id] = self._register(writer, schema, channel)
            number = numbers[channel.id]
            rows = self.message(channel, message) if number is not None else []
            for own_step, time, content in rows:
                writer.add_message(number or 0, time, content, time, own_step)
        writer.finish()
        return out.getvalue()

    def _register(self, writer: Writer, schema: Any, channel: Any) -> int | None:
        row = self.channel(schema, channel)
        if row is None:
            return None
        name, data, topic, metadata = row
        number = writer.register_schema(name, schema.encoding, data)
        return writer.register_channel(topic, channel.message_encoding, number, metadata)


def rewritten(_chance: random.Random, data: bytes) -> bytes:
    """Return the recording again in other chunks, with nothing changed."""
    return Copy().of(data)


def message_dropped(chance: random.Random, data: bytes) -> bytes:
    """Leave one message out; the hash chain stays."""
    victim = _victim(chance, data)
    return Copy(message=lambda c, m: [] if _is(victim, c, m) else _same(m)).of(data)


def message_changed(chance: random.Random, data: bytes) -> bytes:
    """Change one message; the hash chain stays."""
    victim = _victim(chance, data)

    def changed(content: bytes) -> bytes:
        at = chance.randrange(len(content))
        return content[:at] + bytes((content[at] ^ 1,)) + content[at + 1 :]

    return Copy(
        message=lambda c, m: (
            [(m.sequence, m.log_time, changed(m.data))] if _is(victim, c, m) else _same(m)
        )
    ).of(data)


def message_moved(chance: random.Random, data: bytes) -> bytes:
    """Give one message another step."""
    victim, other = _victim(chance, data), chance.choice((0, 7, 2**32 - 1))
    step = other if other != victim[1] else other + 1
    return Copy(
        message=lambda c, m: [(step, m.log_time, m.data)] if _is(victim, c, m) else _same(m)
    ).of(data)


def message_repeated(chance: random.Random, data: bytes) -> bytes:
    """Write one message twice."""
    victim = _victim(chance, data)
    return Copy(message=lambda c, m: _same(m) * (2 if _is(victim, c, m) else 1)).of(data)


def channel_changed(chance: random.Random, data: bytes) -> bytes:
    """Change topic, type or description of some channels, or leave them out."""

    def channel(schema: Any, channel: Any) -> Any:
        name, topic, metadata = schema.name, channel.topic, dict(channel.metadata)
        match chance.randrange(12):
            case 0:
                name = chance.choice(("", "stepbus.", "stepbus.JointState/1", "stepbus.Later/9"))
            case 1:
                topic = chance.choice(("", "/", "plant", "a/b/c", "plant/joint_state", CHAIN))
            case 2 | 3:
                metadata["description"] = chance.choice(DESCRIPTIONS)
            case 4:
                metadata = {}
            case 5:
                return None
        return name, chance.choice((schema.data, schema.data, b"", b"{")), topic, metadata

    return Copy(channel=channel).of(data)


def attachment_changed(chance: random.Random, data: bytes) -> bytes:
    """Change some attachments, or leave them out."""

    def attachment(name: str, content: bytes) -> bytes | None:
        match chance.randrange(4):
            case 0:
                return None if chance.random() < 0.4 else chance.randbytes(20)
            case 1 if name == "scenario.yaml":
                lines = content.decode().splitlines()
                at = chance.randrange(len(lines))
                lines[at] = chance.choice(
                    ("", "participants: 3", "  - x", "{", lines[-1], json.dumps(lines[at]))
                )
                return "\n".join(lines).encode()
        return content

    return Copy(attachment=attachment).of(data)


def metadata_dropped(chance: random.Random, data: bytes) -> bytes:
    """Leave metadata records out, or empty them."""
    return Copy(metadata=lambda _name, text: chance.choice((None, {}, text))).of(data)


def _same(message: Any) -> list[tuple[int, int, bytes]]:
    return [(message.sequence, message.log_time, message.data)]


def _victim(chance: random.Random, data: bytes) -> tuple[str, int]:
    """Return topic and step of a message of a participant."""
    reader = make_reader(io.BytesIO(data))
    rows = [(c.topic, m.sequence) for _, c, m in reader.iter_messages() if c.topic != CHAIN]
    return chance.choice(rows)


def _is(victim: tuple[str, int], channel: Any, message: Any) -> bool:
    return bool((channel.topic, message.sequence) == victim)


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
