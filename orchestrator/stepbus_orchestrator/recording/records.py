"""The records of an MCAP file, each checked before anything of it is used."""

from __future__ import annotations

import contextlib
import os
import struct
import weakref
from collections.abc import Callable, Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import zstandard
from isal.isal_zlib import crc32
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_participant import open_regular

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
CRC_BYTES = 4
LATEST_NS = 2**63 - 1

STEP_END = 0x81
"""Record that follows messages outside of a chunk: they end with a whole step."""
LOOSE = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))
"""What a chunk holds; in a file of ours that is not closed, it follows the last chunk too."""
_WITHOUT_MESSAGES = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, STEP_END))
_FIRST_PRIVATE_OPCODE = 0x80
_KNOWN = frozenset(map(int, Opcode))
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
PARSE_ERRORS = (
    McapError,
    MemoryError,
    OverflowError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)
"""What the mcap package raises for records that are none."""

Row = tuple[int, int, int, bytes]
"""One message: its channel, step, simulation time [ns] and bytes."""


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
        opcode, length = read_head(self.read(offset, HEAD.size), offset, self.size)
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


def read_head(head: bytes, offset: int, size: int) -> tuple[int, int]:
    """Return opcode and length of the record at `offset` of `size` bytes.

    Raises DamagedRecord when no such record can stand there.
    """
    if len(head) < HEAD.size:
        raise DamagedRecord(f"it ends in the header of the record at byte {offset}")
    opcode, length = HEAD.unpack(head)
    if opcode not in _KNOWN and opcode < _FIRST_PRIVATE_OPCODE:
        raise DamagedRecord(f"byte {offset}: {opcode} is not a record type")
    missing = offset + HEAD.size + length - size
    if missing > 0:
        raise DamagedRecord(f"the {type_of(opcode)} at byte {offset} is {missing} bytes short")
    return opcode, length


def parsed(opcode: int, content: bytes) -> Any:
    """Return the record of an opcode and its content; None for a private one.

    Raises DamagedRecord when it contradicts itself, or its checksum is wrong.
    """
    if opcode >= _FIRST_PRIVATE_OPCODE:
        return None
    stream = BytesIO(HEAD.pack(opcode, len(content)) + content)
    with _translated(opcode):
        if opcode == Opcode.ATTACHMENT:
            expected = int.from_bytes(content[-CRC_BYTES:], "little")
            if expected and crc32(content[:-CRC_BYTES]) != expected:
                raise ValueError("its checksum is wrong")
        reader = StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=None)
        return next(reader.records)


def chunk_content(content: bytes) -> bytes:
    """Return the records in a chunk; raises DamagedRecord when it, or its checksum, is wrong."""
    chunk = parsed(Opcode.CHUNK, content)
    with _translated(Opcode.CHUNK):
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        if size != chunk.uncompressed_size:
            raise ValueError(f"it contains {size} bytes, not {chunk.uncompressed_size}")
        return stream.read(size)


@contextlib.contextmanager
def _translated(opcode: int) -> Iterator[None]:
    try:
        yield
    except PARSE_ERRORS as exc:
        why = str(exc) or type(exc).__name__
        raise DamagedRecord(f"a {type_of(opcode)} is corrupt: {why}") from exc


def messages(
    data: bytes,
    channels: Collection[int] | None = None,
    describe: Callable[[Any], None] | None = None,
) -> Iterator[Row]:
    """Yield the messages among records such as those of a chunk; raises DamagedRecord.

    channels: their channels; None: all. describe: gets the schemas and channels among them.
    """
    # StreamReader takes eight times as long for each message.
    unpack, message, fixed = _MESSAGE.unpack_from, int(Opcode.MESSAGE), _MESSAGE.size
    offset, size = 0, len(data)
    while offset < size:
        if size - offset < fixed or data[offset] != message:
            start = offset + HEAD.size
            opcode, length = read_head(data[offset:start], offset, size)
            if opcode not in _WITHOUT_MESSAGES:
                raise DamagedRecord(f"unexpected record of type {type_of(opcode)}")
            offset = start + length
            if describe is not None:
                describe(parsed(opcode, data[start:offset]))
            continue
        _, length, channel, step, t_ns, _ = unpack(data, offset)
        end = offset + HEAD.size + length
        if end < offset + fixed or end > size or t_ns > LATEST_NS:
            raise DamagedRecord(f"inside a chunk: a message of {length} bytes at {t_ns} ns")
        if channels is None or channel in channels:
            yield channel, step, t_ns, data[offset + fixed : end]
        offset = end


def bytes_of(*records: mcap.McapRecord) -> bytes:
    """Return records as they stand in a file."""
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data
