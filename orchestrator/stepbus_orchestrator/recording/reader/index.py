"""What a recording holds and where, without its messages.

A complete recording says so in its summary section: that is read at once, however large the file
is. Any other file is scanned from its beginning.
"""

import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Header,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.records import HEAD, MAGIC, DamagedRecord, records_of
from stepbus_orchestrator.recording.scanner import Scanner

_FOOTER = struct.Struct("<QQI")  # start of the summary, of its offsets, CRC
_CHUNK_INDEX = struct.Struct("<QQQQI")  # two times, offset and length of the chunk, map bytes
_MESSAGE_INDEX = struct.Struct("<HQ")
_TAIL_BYTES = HEAD.size + _FOOTER.size + len(MAGIC)


@dataclass(frozen=True, slots=True)
class Block:
    """A chunk, or a message outside of one: offset and length [bytes], channels in it.

    start_ns: time of its first message [ns].
    """

    offset: int
    length: int
    channels: frozenset[int]
    start_ns: int


@dataclass(kw_only=True)
class Index:
    """What a recording holds.

    damage: what is wrong with the file, empty when nothing is. ends_a_step: whether nothing of its
    last step is missing, as far as that is known without reading its messages. loose_from: where
    messages begin that are in no chunk yet, as the file was not closed.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    schema_texts: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    library: str = ""
    damage: str = ""
    ends_a_step: bool = False
    loose_from: int | None = None

    @property
    def is_ours(self) -> bool:
        """Return whether we wrote it: everything in it has a checksum."""
        return self.library in layout.LIBRARIES

    def add(self, record: object) -> None:
        """Add what a record says, unless it is a message."""
        match record:
            case Schema():
                self.schemas[record.id] = record.name
                self.schema_texts[record.name] = record.data
            case Channel():
                self.channels.setdefault(record.id, record)
            case Attachment():
                self.attachments[record.name] = record.data
            case Metadata():
                self.metadata[record.name] = record.metadata
            case Header():
                self.library = record.library


def read_index(path: Path, file: int) -> Index:
    """Return the index of a recording. file: its descriptor.

    Raises RecordingFailed when it cannot be read or is no MCAP file.
    """
    try:
        index = _Summary(file).read()
    except (DamagedRecord, OSError, ValueError, struct.error):
        index = None
    return index or _scan(path)


def _scan(path: Path) -> Index:
    index, scanner = Index(), Scanner(path)
    for scanned in scanner.scan():
        for record in scanned.records:
            index.add(record)
        messages = [record for record in scanned.records if isinstance(record, Message)]
        if messages:
            channels = frozenset(message.channel_id for message in messages)
            start_ns = min(message.log_time for message in messages)
            index.blocks.append(Block(scanned.offset, scanned.length, channels, start_ns))
        if scanned.opcode == Opcode.MESSAGE and index.loose_from is None:
            index.loose_from = scanned.offset
    index.damage = scanner.damage
    index.ends_a_step = scanner.ends_a_step
    return index


class _Summary:
    """Reads the summary section of a recording of ours; raises DamagedRecord, ValueError."""

    def __init__(self, file: int) -> None:
        self._file = file
        self._size = os.fstat(file).st_size
        self._index = Index()
        self._channel_sets: dict[frozenset[int], frozenset[int]] = {}
        self._statistics: Statistics | None = None
        self._attached: list[AttachmentIndex | MetadataIndex] = []

    def read(self) -> Index | None:
        """Return the index; None where there is no summary that says it all."""
        section = self._section()
        if section is None or not self._is_ours():
            return None
        for opcode, content in _walk(section):
            self._take(opcode, content)
        if not self._is_complete():
            return None
        for row in self._attached:
            for record in self._records_at(row.offset, row.length):
                self._index.add(record)
        self._index.ends_a_step = self._index.library == layout.LIBRARY
        return self._index

    def _section(self) -> bytes | None:
        tail = os.pread(self._file, _TAIL_BYTES, max(0, self._size - _TAIL_BYTES))
        if len(tail) < _TAIL_BYTES or not tail.endswith(MAGIC):
            return None
        opcode, length = HEAD.unpack_from(tail)
        start, _, crc = _FOOTER.unpack_from(tail, HEAD.size)
        footer = self._size - _TAIL_BYTES
        if opcode != Opcode.FOOTER or length != _FOOTER.size or not 0 < start <= footer or not crc:
            return None
        section = os.pread(self._file, footer - start, start)
        checked = zlib.crc32(tail[: HEAD.size + 16], zlib.crc32(section))
        return section if checked == crc else None

    def _is_ours(self) -> bool:
        head = os.pread(self._file, len(MAGIC) + HEAD.size, 0)
        if not head.startswith(MAGIC) or len(head) < len(MAGIC) + HEAD.size:
            return False
        opcode, length = HEAD.unpack_from(head, len(MAGIC))
        if opcode != Opcode.HEADER or length > self._size:
            return False
        for record in self._records_at(len(MAGIC), HEAD.size + length):
            self._index.add(record)
        return self._index.is_ours

    def _take(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.CHUNK_INDEX:
            self._take_chunk(content)
        elif opcode == Opcode.STATISTICS:
            self._statistics = Statistics.read(_stream(content))
        elif opcode in _ATTACHED:
            self._attached.append(_ATTACHED[opcode](_stream(content)))
        elif opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
            for record in records_of(opcode, content):
                self._index.add(record)

    def _take_chunk(self, content: bytes) -> None:
        start_ns, _, offset, length, size = _CHUNK_INDEX.unpack_from(content)
        if offset + length > self._size:
            raise DamagedRecord("a chunk lies behind the end of the file")
        rows = content[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
        channels = frozenset(channel for channel, _ in _MESSAGE_INDEX.iter_unpack(rows))
        # A long recording has many chunks and few sets of channels.
        channels = self._channel_sets.setdefault(channels, channels)
        self._index.blocks.append(Block(offset, length, channels, start_ns))

    def _is_complete(self) -> bool:
        """Return whether the summary lists all that the statistics count."""
        counted, index = self._statistics, self._index
        if counted is None:
            return False
        listed = (len(index.blocks), len(index.channels), len(self._attached))
        expected = (
            counted.chunk_count,
            counted.channel_count,
            counted.attachment_count + counted.metadata_count,
        )
        in_chunks = set().union(*self._channel_sets)
        with_messages = {c for c, n in counted.channel_message_counts.items() if n}
        return listed == expected and in_chunks == with_messages

    def _records_at(self, offset: int, length: int) -> Iterator[object]:
        data = os.pread(self._file, length, offset)
        for opcode, content in _walk(data):
            yield from records_of(opcode, content, checked=self._index.is_ours)


_ATTACHED: Mapping[int, Callable[[Any], AttachmentIndex | MetadataIndex]] = {
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
}


def _walk(data: bytes) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while offset < len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        start = offset + HEAD.size
        offset = start + length
        if offset > len(data):
            raise DamagedRecord("a record of the summary is not complete")
        yield opcode, data[start:offset]


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))
