"""Reads the records of an MCAP file one after the other, up to the first that is damaged."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema

from stepbus_orchestrator.errors import RecordingFailed

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD_BYTES = 22
_CRC_BYTES = 4
_FIRST_PRIVATE_OPCODE = 0x80
_KNOWN = frozenset(int(opcode) for opcode in Opcode)
_INSIDE_CHUNKS = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))
_FOREIGN_ERRORS = (
    McapError,
    MemoryError,
    OverflowError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)


class _Damaged(Exception):
    """A record is not whole; the text says why."""


class Salvage:
    """One pass over a file that may be cut off or spoilt anywhere.

    size: of the file [bytes]. intact_bytes: up to the end of the last record that is whole, for
    a chunk with all it contains. damage: what is wrong behind that, empty when nothing is.
    has_end: whether the end of the data was reached, so that at most the index is missing.

    Raises RecordingFailed when the file cannot be read or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self.intact_bytes = 0
        self.damage = ""
        self.has_end = False
        self._channels: set[int] = set()

    def records(self) -> Iterator[McapRecord]:
        """Return the header, schemas, channels, messages, attachments and metadata in order.

        Records that only index others are left out, and so are those of private kinds, whose
        meaning nobody here knows.
        """
        try:
            with self.path.open("rb") as file:
                self.size = file.seek(0, 2)
                file.seek(0)
                self._take_magic(file)
                yield from self._until_damage(file)
        except RecordingFailed:
            raise
        except OSError as exc:
            raise RecordingFailed(f"{self.path} cannot be read: {exc.strerror or exc}") from exc

    def _take_magic(self, file: IO[bytes]) -> None:
        start = file.read(len(MAGIC))
        if MAGIC.startswith(start) and start != MAGIC:
            raise RecordingFailed(
                f"{self.path} has {len(start)} bytes: there is nothing to recover"
            )
        if start != MAGIC:
            raise RecordingFailed(
                f"{self.path} is not an MCAP recording: it does not begin with its magic bytes"
            )
        self.intact_bytes = len(MAGIC)

    def _until_damage(self, file: IO[bytes]) -> Iterator[McapRecord]:
        try:
            yield from self._whole(file)
        except _Damaged as exc:
            self.damage = str(exc)

    def _whole(self, file: IO[bytes]) -> Iterator[McapRecord]:
        for opcode, content in _walk(file, self.size):
            for record in _records(opcode, content):
                self._check_channel(record)
                yield record
            self.has_end = self.has_end or opcode == Opcode.DATA_END
            self.intact_bytes = file.tell()
            if opcode == Opcode.FOOTER:
                self._take_end(file)
                return
        raise _Damaged("the file ends before its end record: it was cut off between two")

    def _check_channel(self, record: McapRecord) -> None:
        """Raise _Damaged for a message of a channel that no record before it describes."""
        if isinstance(record, Channel):
            self._channels.add(record.id)
        elif isinstance(record, Message) and record.channel_id not in self._channels:
            raise _Damaged(f"a message is of channel {record.channel_id}, which is not described")

    def _take_end(self, file: IO[bytes]) -> None:
        rest = file.read(len(MAGIC) + 1)
        if rest != MAGIC:
            raise _Damaged("the closing magic bytes are missing, or something follows them")
        self.intact_bytes = self.size


def _walk(file: IO[bytes], size: int) -> Iterator[tuple[int, bytes]]:
    """Return (opcode, content) of record after record; raises _Damaged for one that is not whole.

    size: where the records end [bytes].
    """
    while (offset := file.tell()) < size:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise _Damaged(f"the file ends in the head of the record at byte {offset}")
        opcode, length = _HEAD.unpack(head)
        if opcode not in _KNOWN and opcode < _FIRST_PRIVATE_OPCODE:
            raise _Damaged(f"there is no kind {opcode} of record, as byte {offset} says")
        left = size - offset - _HEAD.size
        if length > left:
            raise _Damaged(f"the {_kind(opcode)} at byte {offset} lacks {length - left} bytes")
        yield opcode, file.read(length)


def _records(opcode: int, content: bytes) -> Iterator[McapRecord]:
    """Return what one record holds; raises _Damaged when it contradicts itself."""
    read = _READERS.get(opcode)
    if read is None:
        return
    try:
        record = read(content)
        if not isinstance(record, Chunk):
            yield record
            return
        inside = _unpack(record)
    except _FOREIGN_ERRORS as exc:
        raise _Damaged(f"a {_kind(opcode)} is spoilt: {str(exc) or type(exc).__name__}") from exc
    try:
        yield from _records_inside(inside)
    except _Damaged as exc:
        raise _Damaged(f"inside a chunk: {exc}") from exc


def _records_inside(data: bytes) -> Iterator[McapRecord]:
    """Return the records of a chunk's content."""
    for opcode, content in _walk(BytesIO(data), len(data)):
        if opcode not in _INSIDE_CHUNKS:
            raise _Damaged(f"a {_kind(opcode)} has no place there")
        yield from _records(opcode, content)


def _unpack(chunk: Chunk) -> bytes:
    """Return the records of a chunk, checked by its CRC where it has one."""
    if chunk.compression == "zstd":
        data = zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size)
    elif not chunk.compression:
        data = chunk.data
    else:
        raise ValueError(f"compression {chunk.compression!r} is not zstd or none")
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"it holds {len(data)} bytes and says {chunk.uncompressed_size}")
    _check_crc(data, chunk.uncompressed_crc)
    return data


def _check_crc(data: bytes, expected: int) -> None:
    """Raise ValueError when a checksum is wrong; 0 stands for none."""
    if expected and zlib.crc32(data) != expected:
        raise ValueError("its checksum is wrong")


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _read_attachment(content: bytes) -> McapRecord:
    _check_crc(content[:-_CRC_BYTES], int.from_bytes(content[-_CRC_BYTES:], "little"))
    record: McapRecord = Attachment.read(_stream(content))
    return record


def _read_message(content: bytes) -> McapRecord:
    if len(content) < _MESSAGE_HEAD_BYTES:
        raise ValueError(f"it has {len(content)} bytes, at least {_MESSAGE_HEAD_BYTES} are needed")
    record: McapRecord = Message.read(_stream(content), len(content))
    return record


def _kind(opcode: int) -> str:
    """Return the kind of a record in words."""
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in _KNOWN else "private record"


def _plain(kind: Any) -> Callable[[bytes], McapRecord]:
    """Return a reader of a kind of record that needs no check of its own."""

    def read(content: bytes) -> McapRecord:
        record: McapRecord = kind.read(_stream(content))
        return record

    return read


_READERS: Mapping[int, Callable[[bytes], McapRecord]] = {
    Opcode.HEADER: _plain(Header),
    Opcode.SCHEMA: _plain(Schema),
    Opcode.CHANNEL: _plain(Channel),
    Opcode.METADATA: _plain(Metadata),
    Opcode.CHUNK: _plain(Chunk),
    Opcode.ATTACHMENT: _read_attachment,
    Opcode.MESSAGE: _read_message,
}
