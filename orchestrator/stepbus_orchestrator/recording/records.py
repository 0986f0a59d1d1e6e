"""The records of an MCAP file, each checked before anything of it is used."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from typing import Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message."""

_CRC_BYTES = 4
STEP_END = 0x81
"""Record that stands behind messages outside of a chunk: they end with a whole step."""
_FIRST_PRIVATE_OPCODE = 0x80
_KNOWN = frozenset(int(opcode) for opcode in Opcode)
_INSIDE_CHUNKS = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))
_PARSE_ERRORS = (
    McapError,
    MemoryError,
    OverflowError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)


class DamagedRecord(Exception):
    """A record is not complete, or contradicts itself; the text says how."""


def type_of(opcode: int) -> str:
    """Return the type of a record in words."""
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in _KNOWN else "private record"


def check_head(opcode: int, length: int, offset: int, size: int) -> None:
    """Raise DamagedRecord when no such record can stand at `offset` of `size` bytes."""
    if opcode not in _KNOWN and opcode < _FIRST_PRIVATE_OPCODE:
        raise DamagedRecord(f"byte {offset}: {opcode} is no record type")
    left = size - offset - HEAD.size
    if length > left:
        raise DamagedRecord(f"the {type_of(opcode)} at byte {offset} lacks {length - left} bytes")


def records_of(opcode: int, content: bytes, *, checked: bool = False) -> Iterator[McapRecord]:
    """Yield what one record holds: itself, or all that is in a chunk; nothing of an index.

    checked: whether chunks and attachments must have checksums. Raises DamagedRecord when it
    contradicts itself.
    """
    read = _READERS.get(opcode)
    if read is None:
        return
    try:
        if opcode == Opcode.ATTACHMENT:
            check_attachment(content, checked=checked)
        record = read(content)
        inside = unpack(record, checked=checked) if isinstance(record, Chunk) else None
    except _PARSE_ERRORS as exc:
        raise _corrupt(opcode, exc) from exc
    if inside is None:
        yield record
        return
    try:
        for inner, data in walk(inside):
            yield from records_of(inner, data)
    except DamagedRecord as exc:
        raise DamagedRecord(f"inside a chunk: {exc}") from exc


def chunk_content(content: bytes, *, checked: bool) -> bytes:
    """Return the records inside a chunk; raises DamagedRecord when it is corrupt."""
    try:
        return unpack(Chunk.read(_stream(content)), checked=checked)
    except _PARSE_ERRORS as exc:
        raise _corrupt(Opcode.CHUNK, exc) from exc


def walk(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) of each record inside a chunk; raises DamagedRecord."""
    offset, size = 0, len(data)
    while offset < size:
        if size - offset < HEAD.size:
            raise DamagedRecord(f"it ends in the head of the record at byte {offset}")
        opcode, length = HEAD.unpack_from(data, offset)
        check_head(opcode, length, offset, size)
        if opcode not in _INSIDE_CHUNKS:
            raise DamagedRecord(f"a {type_of(opcode)} does not belong there")
        start = offset + HEAD.size
        offset = start + length
        yield opcode, data[start:offset]


def unpack(chunk: Chunk, *, checked: bool) -> bytes:
    """Return the records of a chunk; raises ValueError when it, or its checksum, is wrong."""
    data: bytes
    if chunk.compression == "zstd":
        data = zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size)
    elif not chunk.compression:
        data = chunk.data
    else:
        raise ValueError(f"compression {chunk.compression!r} is not zstd or none")
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"it holds {len(data)} bytes, not {chunk.uncompressed_size}")
    check_crc(data, chunk.uncompressed_crc, checked=checked)
    return data


def _corrupt(opcode: int, exc: BaseException) -> DamagedRecord:
    return DamagedRecord(f"a {type_of(opcode)} is corrupt: {str(exc) or type(exc).__name__}")


def check_crc(data: bytes, expected: int, *, checked: bool) -> None:
    """Raise ValueError when a checksum is wrong; unless `checked`, 0 stands for none."""
    if (expected or checked) and zlib.crc32(data) != expected:
        raise ValueError("its checksum is wrong")


def check_attachment(content: bytes, *, checked: bool) -> None:
    """Raise ValueError when the checksum of an attachment is wrong."""
    expected = int.from_bytes(content[-_CRC_BYTES:], "little")
    check_crc(content[:-_CRC_BYTES], expected, checked=checked)


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _read_message(content: bytes) -> McapRecord:
    if len(content) < MESSAGE_HEAD.size:
        raise ValueError(f"it has {len(content)} bytes, at least {MESSAGE_HEAD.size} are needed")
    record: McapRecord = Message.read(_stream(content), len(content))
    return record


def _plain(record_type: Any) -> Callable[[bytes], McapRecord]:
    """Return a reader of a record type that needs no check of its own."""

    def read(content: bytes) -> McapRecord:
        record: McapRecord = record_type.read(_stream(content))
        return record

    return read


_READERS: Mapping[int, Callable[[bytes], McapRecord]] = {
    Opcode.HEADER: _plain(Header),
    Opcode.SCHEMA: _plain(Schema),
    Opcode.CHANNEL: _plain(Channel),
    Opcode.METADATA: _plain(Metadata),
    Opcode.CHUNK: _plain(Chunk),
    Opcode.ATTACHMENT: _plain(Attachment),
    Opcode.MESSAGE: _read_message,
}
