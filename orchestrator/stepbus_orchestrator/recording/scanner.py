"""Scans an MCAP file record by record, up to the first that is damaged."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Channel, Header, McapRecord, Message

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.records import (
    HEAD,
    MAGIC,
    STEP_END,
    DamagedRecord,
    check_head,
    records_of,
)
from stepbus_participant import open_regular

_CRC_BYTES = 4


@dataclass(frozen=True, kw_only=True)
class Scanned:
    """One record of a file: its position [bytes], and what it holds.

    records: itself, or all that is in a chunk up to a damage; none where it only indexes others or
    is of a private type.
    """

    offset: int
    length: int
    opcode: int
    records: list[McapRecord]


class Scanner:
    """One pass over a file that may be cut off or corrupt anywhere.

    size: of the file [bytes]. intact_bytes: up to the end of the last complete record, for a
    chunk with all it contains. damage: what is wrong behind that, empty when nothing is. has_end:
    whether the end of the data was reached, so that at most the index is missing. ends_a_step:
    whether nothing of the last message's step is missing; taken for granted of other programs.

    Raises RecordingFailed when the file cannot be read or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self.intact_bytes = 0
        self.damage = ""
        self.has_end = False
        self.ends_a_step = True
        self._channels: dict[int, str] = {}
        self._library = ""
        self._crc = 0

    def records(self) -> Iterator[McapRecord]:
        """Yield header, schemas, channels, messages, attachments and metadata in order."""
        for scanned in self.scan():
            yield from scanned.records

    def scan(self) -> Iterator[Scanned]:
        """Yield each record of the file; the last one may be damaged inside."""
        try:
            with os.fdopen(open_regular(self.path), "rb") as file:
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
                f"{self.path} is not an MCAP recording: it does not start with its magic bytes"
            )
        self.intact_bytes = len(MAGIC)
        self._crc = zlib.crc32(MAGIC)

    def _until_damage(self, file: IO[bytes]) -> Iterator[Scanned]:
        try:
            yield from self._complete(file)
        except DamagedRecord as exc:
            self.damage = str(exc)

    def _complete(self, file: IO[bytes]) -> Iterator[Scanned]:
        while (offset := file.tell()) < self.size:
            opcode, content = self._read(file, offset)
            scanned = Scanned(offset=offset, length=file.tell() - offset, opcode=opcode, records=[])
            try:
                for record in records_of(opcode, content, checked=self._is_ours()):
                    self._check_channel(record)
                    if isinstance(record, Header):
                        self._library = record.library
                    scanned.records.append(record)
            finally:
                # A chunk may be damaged inside: what precedes it is complete.
                yield scanned
            if opcode == STEP_END or (opcode == Opcode.CHUNK and self._library == layout.LIBRARY):
                self.ends_a_step = True
            self.has_end = self.has_end or opcode == Opcode.DATA_END
            self.intact_bytes = file.tell()
            self._take_checksum(opcode, content)
            if opcode == Opcode.FOOTER:
                self._take_end(file)
                return
        raise DamagedRecord("the file ends before its end record: it was cut off between two")

    def _read(self, file: IO[bytes], offset: int) -> tuple[int, bytes]:
        head = file.read(HEAD.size)
        if len(head) < HEAD.size:
            raise DamagedRecord(f"the file ends in the head of the record at byte {offset}")
        opcode, length = HEAD.unpack(head)
        check_head(opcode, length, offset, self.size)
        return opcode, file.read(length)

    def _is_ours(self) -> bool:
        return self._library in layout.LIBRARIES

    def _take_checksum(self, opcode: int, content: bytes) -> None:
        """Add a record to the checksum of its section; raise DamagedRecord where that is wrong."""
        record = HEAD.pack(opcode, len(content)) + content
        if opcode == Opcode.DATA_END:
            self._check_section(
                "data section", content, must=self._is_ours() and self._library != layout.FIRST
            )
            self._crc = 0
        elif opcode == Opcode.FOOTER:
            self._crc = zlib.crc32(record[:-_CRC_BYTES], self._crc)
            self._check_section("summary", content, must=self._is_ours())
        else:
            self._crc = zlib.crc32(record, self._crc)

    def _check_section(self, name: str, content: bytes, *, must: bool) -> None:
        expected = int.from_bytes(content[-_CRC_BYTES:], "little")
        if (expected or must) and expected != self._crc:
            raise DamagedRecord(
                f"the checksum of the {name} is wrong: something in it is not what was written"
            )

    def _check_channel(self, record: McapRecord) -> None:
        """Raise DamagedRecord for a message of a channel that no record before it describes."""
        if isinstance(record, Channel):
            self._channels.setdefault(record.id, record.topic)
        elif isinstance(record, Message) and record.channel_id not in self._channels:
            raise DamagedRecord(
                f"a message is of channel {record.channel_id}, which is not described"
            )
        elif isinstance(record, Message) and self._is_ours():
            # Written last, it shows that nothing of its step is missing.
            self.ends_a_step = self._channels[record.channel_id] == layout.CHAIN_TOPIC

    def _take_end(self, file: IO[bytes]) -> None:
        rest = file.read(len(MAGIC) + 1)
        if rest != MAGIC:
            raise DamagedRecord("the closing magic bytes are missing, or something follows them")
        self.intact_bytes = self.size
