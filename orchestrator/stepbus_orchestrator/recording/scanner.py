"""Scans an MCAP file record by record, up to the first that is damaged."""

from __future__ import annotations

from collections.abc import Generator, Iterator

from isal.isal_zlib import crc32
from mcap import records as mcap
from mcap.opcode import Opcode

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.index import Block, Index
from stepbus_orchestrator.recording.records import (
    CRC_BYTES,
    HEAD,
    MAGIC,
    STEP_END,
    DamagedRecord,
    RecordFile,
    records_of,
)


class Scanner:
    """One pass over a file that may be cut off or corrupt anywhere.

    file: that it scans. index: what it holds, as far as it was scanned; what is wrong behind that
    is its `damage`. That files of other programs end with a whole step is taken for granted. size:
    of the file [bytes]. intact_bytes: up to the end of the last complete record, for a chunk with
    all it contains. has_end: whether the end of the data was reached, so that at most the index is
    missing.
    """

    def __init__(self, file: RecordFile) -> None:
        self.index = Index(path=file.path)
        self.size = file.size
        self.intact_bytes = 0
        self.has_end = False
        self.file = file
        self._crc = 0
        self._done = 0
        """No step below it comes any more: what has one was left by an earlier write."""

    def records(self) -> Iterator[mcap.McapRecord]:
        """Yield all records but those of the index, the messages of a chunk one by one.

        Raises RecordingFailed when the file cannot be read or is no MCAP file.
        """
        start = self.file.read(0, len(MAGIC))
        if start != MAGIC:
            raise RecordingFailed(
                f"{self.file.path} has {len(start)} bytes: there is nothing to recover"
                if MAGIC.startswith(start)
                else f"{self.file.path} is not an MCAP recording: it does not start with its magic "
                "bytes"
            )
        self.intact_bytes, self._crc = len(MAGIC), crc32(MAGIC)
        try:
            opcode = 0
            while opcode != Opcode.FOOTER:
                opcode = yield from self._next()
            if self.file.read(self.intact_bytes, len(MAGIC) + 1) == MAGIC:
                self.intact_bytes = self.size
            else:
                self.index.damage = "the closing magic bytes are missing, or more follows them"
        except DamagedRecord as exc:
            self.index.damage = str(exc)

    def _next(self) -> Generator[mcap.McapRecord, None, int]:
        """Yield what is in the record behind the last intact one; return its opcode."""
        offset, index = self.intact_bytes, self.index
        if offset >= self.size:
            raise DamagedRecord(
                "the file ends before its end record: it was truncated between two records"
            )
        opcode, content = self.file.record(offset)
        length = HEAD.size + len(content)
        channels, times = set(), []
        try:
            for record in records_of(opcode, content, checked=index.is_ours):
                if isinstance(record, mcap.Message):
                    self._check_message(record)
                    channels.add(record.channel_id)
                    times.append(record.log_time)
                else:
                    index.add(record)
                yield record
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

    def _check_message(self, message: mcap.Message) -> None:
        """Raise DamagedRecord for a message of a channel that no record before it describes."""
        channel = self.index.channels.get(message.channel_id)
        if channel is None:
            raise DamagedRecord(
                f"a message is of channel {message.channel_id} that has no Channel record"
            )
        if self.index.is_ours:
            if message.sequence < self._done:
                raise DamagedRecord(
                    f"a message of step {message.sequence} follows later ones: the write "
                    "that should replace it was interrupted"
                )
            self._done = message.sequence
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
