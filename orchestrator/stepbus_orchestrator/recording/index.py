"""What a recording holds and where, without its messages.

A complete recording says so in its summary section: that is read at once, however large the file
is. Any other file is scanned from its beginning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any

from isal.isal_zlib import crc32
from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.records import (
    CRC_BYTES,
    HEAD,
    LOOSE,
    MAGIC,
    PARSE_ERRORS,
    STEP_END,
    DamagedRecord,
    RecordFile,
    bytes_of,
    chunk_content,
    messages,
    parsed,
)
from stepbus_participant.parameters import is_name, parse_yaml
from stepbus_schemas import StepbusError

_TAIL_BYTES = len(bytes_of(mcap.Footer(0, 0, 0))) + len(MAGIC)


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

    Names become those of files, and lines of a terminal: a recording with a scenario, participant
    or port whose name no scenario accepts raises RecordingFailed, whatever reads it.
    """

    path: Path
    schemas: dict[int, mcap.Schema] = field(default_factory=dict)
    channels: dict[int, mcap.Channel] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    header: mcap.Header | None = None
    damage: str = ""
    ends_a_step: bool = True
    loose_from: int | None = None

    @property
    def is_ours(self) -> bool:
        """Return whether we wrote it: everything in it has a checksum."""
        return self.library in layout.LIBRARIES

    @property
    def library(self) -> str:
        """Return who wrote it, and in which layout; empty where it does not say."""
        return "" if self.header is None else self.header.library

    @cached_property
    def scenario(self) -> Mapping[str, Any]:
        """Return the content of the recorded scenario; an empty one where it cannot be read."""
        text = self.attachments.get(layout.SCENARIO_ATTACHMENT, b"").decode(errors="replace")
        try:
            content = parse_yaml(layout.SCENARIO_ATTACHMENT, text)
        except StepbusError:
            return {}
        if not isinstance(content, dict):
            return {}
        participants = content.get("participants")
        names = list(participants) if isinstance(participants, dict) else []
        for name in names + [content[key] for key in ("name",) if key in content]:
            if not (isinstance(name, str) and is_name(name)):
                raise self._not_ours(name)
        return content

    def add(self, record: object) -> None:
        """Add what a record says, unless it is a message."""
        match record:
            case mcap.Schema():
                self.schemas[record.id] = record
            case mcap.Channel():
                # Those of timing.mcap have one name.
                if not all(map(is_name, record.topic.split("/", 1))):
                    raise self._not_ours(record.topic)
                self.channels.setdefault(record.id, record)
            case mcap.Attachment():
                self.attachments[record.name] = record.data
            case mcap.Metadata():
                self.metadata[record.name] = record.metadata
            case mcap.Header():
                self.header = record
                if layout.is_newer(self.library):
                    raise RecordingFailed(
                        f"{self.path} has layout {self.library!r}, which is newer than this "
                        f"stepbus: it reads layouts up to {layout.LIBRARY!r}; update stepbus "
                        "(docs/compatibility.md)"
                    )

    def _not_ours(self, name: object) -> RecordingFailed:
        return RecordingFailed(
            f"{self.path} is not from stepbus, or from a newer version: {name!r} is not a valid "
            "name"
        )


def read_summary(file: RecordFile) -> Index | None:
    """Return the index of a recording of ours; None where no summary says all of it."""
    index, end = Index(path=file.path), max(0, file.size - _TAIL_BYTES)
    try:
        footer = parsed(*file.record(end))
        if not (isinstance(footer, mcap.Footer) and 0 < footer.summary_start <= end):
            return None
        section = file.read(footer.summary_start, end - footer.summary_start)
        checked = bytes_of(footer)[:-CRC_BYTES]
        index.add(parsed(*file.record(len(MAGIC))))
        if crc32(checked, crc32(section)) != footer.summary_crc or not index.is_ours:
            return None
        summary = BytesIO(section + file.read(end, _TAIL_BYTES))
        for record in StreamReader(summary, skip_magic=True).records:
            if isinstance(record, mcap.ChunkIndex):
                index.blocks.append(_block(record, index.blocks))
            elif isinstance(record, mcap.AttachmentIndex | mcap.MetadataIndex):
                index.add(parsed(*file.record(record.offset)))
            else:
                index.add(record)
    except (DamagedRecord, *PARSE_ERRORS):
        return None
    index.ends_a_step = index.library == layout.LIBRARY
    return index


def _block(row: mcap.ChunkIndex, before: Sequence[Block]) -> Block:
    channels = frozenset(row.message_index_offsets)
    # A long recording has many chunks and few sets of channels.
    if before and channels == before[-1].channels:
        channels = before[-1].channels
    return Block(row.chunk_start_offset, row.chunk_length, channels, row.message_start_time)


class Scanner:
    """One pass over a file that may be cut off or corrupt anywhere.

    file: that it scans. index: what it holds, as far as it was scanned; what is wrong after that
    is its `damage`. That files of other programs end with a whole step is taken for granted. size:
    of the file [bytes]. intact_bytes: up to the end of the last complete record, for a chunk with
    all it contains. has_end: whether the end of the data was reached, so that at most the index is
    missing.

    Raises RecordingFailed when the file cannot be read or is no MCAP file.
    """

    def __init__(self, file: RecordFile) -> None:
        self.index = Index(path=file.path)
        self.size = file.size
        self.has_end = False
        self.file = file
        self._done = 0
        """No step below it comes any more: what has one was left by an earlier write."""
        start = file.read(0, len(MAGIC))
        if start != MAGIC:
            raise RecordingFailed(
                f"{file.path} has {len(start)} bytes: there is nothing to recover"
                if MAGIC.startswith(start)
                else f"{file.path} is not an MCAP recording: it does not start with its magic bytes"
            )
        self.intact_bytes, self._crc = len(MAGIC), crc32(MAGIC)
        try:
            while self._take_next() != Opcode.FOOTER:
                pass
            if file.read(self.intact_bytes, len(MAGIC) + 1) == MAGIC:
                self.intact_bytes = self.size
            else:
                self.index.damage = "the closing magic bytes are missing, or more follows them"
        except DamagedRecord as exc:
            self.index.damage = str(exc)

    def _take_next(self) -> int:
        """Take the record after the last intact one; return its opcode."""
        offset, index = self.intact_bytes, self.index
        if offset >= self.size:
            raise DamagedRecord(
                "the file ends before its end record: it was truncated between two records"
            )
        opcode, content = self.file.record(offset)
        length, loose = HEAD.size + len(content), b""
        if opcode == Opcode.CHUNK:
            loose = chunk_content(content)
        elif opcode in LOOSE:
            loose = HEAD.pack(opcode, len(content)) + content
        else:
            index.add(parsed(opcode, content))
        channels, times = set(), []
        try:
            for channel, step, t_ns, _ in messages(loose, describe=index.add):
                self._check(step, channel)
                channels.add(channel)
                times.append(t_ns)
        finally:
            # A chunk may be damaged inside: what precedes it is complete.
            if times:
                index.blocks.append(Block(offset, length, frozenset(channels), min(times)))
        if opcode == Opcode.CHUNK and index.library == layout.LIBRARY:
            index.ends_a_step = True
            self._done += 1
        elif opcode == STEP_END:
            index.ends_a_step = True
        if opcode == Opcode.MESSAGE and index.loose_from is None:
            index.loose_from = offset
        self.has_end = self.has_end or opcode == Opcode.DATA_END
        self.intact_bytes += length
        self._take_checksum(opcode, content)
        return opcode

    def _check(self, step: int, number: int) -> None:
        """Raise DamagedRecord for a message that cannot stand here. number: of its channel."""
        channel = self.index.channels.get(number)
        if channel is None:
            raise DamagedRecord(f"a message is of channel {number} that has no Channel record")
        if not self.index.is_ours:
            return
        if step < self._done:
            raise DamagedRecord(
                f"a message of step {step} follows later ones: the write that should replace it "
                "was interrupted"
            )
        self._done = step
        # Written last, it shows that nothing of its step is missing.
        self.index.ends_a_step = channel.topic == layout.CHAIN_TOPIC

    def _take_checksum(self, opcode: int, content: bytes) -> None:
        """Add a record to the checksum of its section; raise DamagedRecord where that is wrong."""
        record = HEAD.pack(opcode, len(content)) + content
        if opcode == Opcode.DATA_END:
            must = self.index.is_ours and self.index.library != layout.FIRST
            record = b""
        elif opcode == Opcode.FOOTER:
            must = self.index.is_ours
            record = record[:-CRC_BYTES]
        self._crc = crc32(record, self._crc)
        if opcode not in {Opcode.DATA_END, Opcode.FOOTER}:
            return
        expected = int.from_bytes(content[-CRC_BYTES:], "little")
        if (expected or must) and expected != self._crc:
            raise DamagedRecord("a checksum is wrong: the file has changed since it was written")
        self._crc = 0
