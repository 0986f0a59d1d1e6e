"""The records of an MCAP file, each checked before anything of it is used."""

from __future__ import annotations

import contextlib
import os
import struct
import weakref
from collections.abc import Collection, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import zstandard
from isal.isal_zlib import crc32
from mcap import records as mcap
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_participant import open_regular

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message."""
CRC_BYTES = 4

STEP_END = 0x81
"""Record that stands behind messages outside of a chunk: they end with a whole step."""
LOOSE = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))
"""What a chunk holds; in a file of ours that is not closed, it stands behind the last chunk too."""

_FIRST_PRIVATE_OPCODE = 0x80
_KNOWN = frozenset(map(int, Opcode))
_TYPES: Mapping[int, Any] = {
    Opcode.HEADER: mcap.Header,
    Opcode.SCHEMA: mcap.Schema,
    Opcode.CHANNEL: mcap.Channel,
    Opcode.CHUNK: mcap.Chunk,
    Opcode.ATTACHMENT: mcap.Attachment,
    Opcode.METADATA: mcap.Metadata,
    Opcode.ATTACHMENT_INDEX: mcap.AttachmentIndex,
    Opcode.METADATA_INDEX: mcap.MetadataIndex,
}
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


class RecordFile:
    """An open MCAP file, read at any position; raises RecordingFailed when it cannot be."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.descriptor = open_regular(path)
        except OSError as exc:
            raise RecordingFailed(f"{path} cannot be read: {_why(path, exc)}") from exc
        self.close = weakref.finalize(self, os.close, self.descriptor)

    @property
    def size(self) -> int:
        """Return its size now [bytes]."""
        return os.fstat(self.descriptor).st_size

    def read(self, offset: int, length: int) -> bytes:
        """Return some bytes; fewer at its end."""
        if not self.close.alive:
            raise RecordingFailed(f"{self.path} is closed")
        try:
            return os.pread(self.descriptor, length, offset)
        except OSError as exc:
            raise RecordingFailed(f"{self.path} cannot be read: {exc.strerror or exc}") from exc

    def record(self, offset: int) -> tuple[int, bytes]:
        """Return opcode and content of a record; raises DamagedRecord when it is not complete."""
        head = self.read(offset, HEAD.size)
        if len(head) < HEAD.size:
            raise DamagedRecord(f"the file ends in the header of the record at byte {offset}")
        opcode, length = HEAD.unpack(head)
        check_head(opcode, length, offset, self.size)
        return opcode, self.read(offset + HEAD.size, length)


def _why(path: Path, exc: OSError) -> str:
    """Return why a recording cannot be opened, and what to give instead."""
    why = str(exc.strerror or exc)
    if not isinstance(exc, FileNotFoundError):
        return why
    if path.parent.is_dir() and path.name == layout.RUN_FILE:
        return f"{why}; {path.parent} is not the folder of a run"
    return f"{why}; give the folder of a run, e.g. runs/two_link-20260101-120000, or its run.mcap"


def type_of(opcode: int) -> str:
    """Return the type of a record in words."""
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in _KNOWN else "private record"


def check_head(opcode: int, length: int, offset: int, size: int) -> None:
    """Raise DamagedRecord when no such record can stand at `offset` of `size` bytes."""
    if opcode not in _KNOWN and opcode < _FIRST_PRIVATE_OPCODE:
        raise DamagedRecord(f"byte {offset}: {opcode} is not a record type")
    missing = offset + HEAD.size + length - size
    if missing > 0:
        raise DamagedRecord(f"the {type_of(opcode)} at byte {offset} is {missing} bytes short")


def split(data: bytes, allowed: Collection[int] | None = None) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of each record.

    allowed: opcodes; None: any. Raises DamagedRecord at a record that is none of these, or is not
    complete.
    """
    offset, size = 0, len(data)
    while offset < size:
        if size - offset < HEAD.size:
            raise DamagedRecord(f"it ends in the header of the record at byte {offset}")
        opcode, length = HEAD.unpack_from(data, offset)
        check_head(opcode, length, offset, size)
        if allowed is not None and opcode not in allowed:
            raise DamagedRecord(f"unexpected record of type {type_of(opcode)}")
        start = offset + HEAD.size
        offset = start + length
        yield opcode, data[start:offset]


def records_of(opcode: int, content: bytes, *, checked: bool = False) -> Iterator[mcap.McapRecord]:
    """Yield what one record holds: itself, or all that is in a chunk; nothing of a private type.

    checked: whether chunks and attachments must have checksums. Raises DamagedRecord when it
    contradicts itself.
    """
    if opcode == Opcode.CHUNK:
        for inner, data in split(chunk_content(content, checked=checked), LOOSE):
            yield from records_of(inner, data)
    elif opcode == Opcode.MESSAGE:
        yield _message(content)
    elif opcode in _TYPES:
        yield _parsed(opcode, content, checked=checked)


def chunk_content(content: bytes, *, checked: bool) -> bytes:
    """Return the records inside a chunk; raises DamagedRecord when it, or its checksum, is wrong.

    checked: whether it must have a checksum.
    """
    chunk = _parsed(Opcode.CHUNK, content)
    data: bytes = chunk.data
    with _translated(Opcode.CHUNK):
        if chunk.compression == "zstd":
            data = zstandard.decompress(data, max_output_size=chunk.uncompressed_size)
        elif chunk.compression:
            raise ValueError(f"compression {chunk.compression!r} is not zstd or none")
        if len(data) != chunk.uncompressed_size:
            raise ValueError(f"it contains {len(data)} bytes, not {chunk.uncompressed_size}")
        _check_crc(data, chunk.uncompressed_crc, checked=checked)
    return data


def _parsed(opcode: int, content: bytes, *, checked: bool = False) -> Any:
    with _translated(opcode):
        if opcode == Opcode.ATTACHMENT:
            expected = int.from_bytes(content[-CRC_BYTES:], "little")
            _check_crc(content[:-CRC_BYTES], expected, checked=checked)
        return _TYPES[opcode].read(ReadDataStream(BytesIO(content)))


def _message(content: bytes) -> mcap.Message:
    if len(content) < MESSAGE_HEAD.size:
        raise DamagedRecord(f"a message is corrupt: it has {len(content)} bytes")
    channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(content)
    return mcap.Message(channel, log_time, content[MESSAGE_HEAD.size :], publish_time, sequence)


def _check_crc(data: bytes, expected: int, *, checked: bool) -> None:
    """Raise ValueError when a checksum is wrong; unless `checked`, 0 stands for none."""
    if (expected or checked) and crc32(data) != expected:
        raise ValueError("its checksum is wrong")


@contextlib.contextmanager
def _translated(opcode: int) -> Iterator[None]:
    try:
        yield
    except _PARSE_ERRORS as exc:
        why = str(exc) or type(exc).__name__
        raise DamagedRecord(f"a {type_of(opcode)} is corrupt: {why}") from exc


def bytes_of(*records: mcap.McapRecord) -> bytes:
    """Return records as they stand in a file."""
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data
