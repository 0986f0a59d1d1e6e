"""The summary section of an MCAP file: what the file holds, and where."""

import dataclasses
from collections import Counter
from collections.abc import Mapping

from isal.isal_zlib import crc32
from mcap import records as mcap
from mcap.opcode import Opcode

from stepbus_orchestrator.recording.records import CRC_BYTES, bytes_of

_GROUPS = (
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
)
"""What the summary section consists of, in its order."""


class Summary:
    """Collects the summary section while a file is written."""

    def __init__(self) -> None:
        self._records = {opcode: bytearray() for opcode in _GROUPS}
        self._counts: Counter[Opcode] = Counter()
        self._message_counts: Counter[int] = Counter()
        self._earliest = self._latest = 0

    @property
    def chunk_index_bytes(self) -> int:
        """Return the size of the index of all chunks so far [bytes]."""
        return len(self._records[Opcode.CHUNK_INDEX])

    def register(self, record: mcap.Schema | mcap.Channel) -> tuple[int, bytes]:
        """Add a schema or channel under the next free number; return that, and its record."""
        opcode = Opcode.SCHEMA if isinstance(record, mcap.Schema) else Opcode.CHANNEL
        number = self._counts[opcode] + 1
        data = bytes_of(dataclasses.replace(record, id=number))
        self._add(opcode, data)
        return number, data

    def add(self, record: mcap.Attachment | mcap.Metadata, offset: int, length: int) -> None:
        """Add an attachment or a metadata record. offset, length: of its record [bytes]."""
        if isinstance(record, mcap.Metadata):
            metadata = mcap.MetadataIndex(offset, length, record.name)
            self._add(Opcode.METADATA_INDEX, bytes_of(metadata))
            return
        attachment = mcap.AttachmentIndex(
            offset=offset,
            length=length,
            log_time=record.log_time,
            create_time=record.create_time,
            data_size=len(record.data),
            name=record.name,
            media_type=record.media_type,
        )
        self._add(Opcode.ATTACHMENT_INDEX, bytes_of(attachment))

    def _add(self, opcode: Opcode, data: bytes) -> None:
        self._records[opcode] += data
        self._counts[opcode] += 1

    def add_chunk(self, indexes: Mapping[int, bytearray], row: mcap.ChunkIndex) -> None:
        """Add a chunk that is in the file. indexes: channel → 16 bytes a message."""
        start_ns = row.message_start_time
        is_first = not self._counts[Opcode.CHUNK_INDEX]
        self._earliest = start_ns if is_first else min(self._earliest, start_ns)
        self._latest = max(self._latest, row.message_end_time)
        for channel, entries in indexes.items():
            self._message_counts[channel] += len(entries) // 16
        self._add(Opcode.CHUNK_INDEX, bytes_of(row))

    def end(self, start: int) -> bytes:
        """Return the section and its footer; to be called once. start: where it begins [bytes]."""
        self._records[Opcode.STATISTICS] += bytes_of(self._statistics())
        offsets, end = [], start
        for opcode, records in self._records.items():
            offsets.append(mcap.SummaryOffset(opcode, end, len(records)))
            end += len(records)
        section = b"".join((*self._records.values(), bytes_of(*offsets)))
        footer = mcap.Footer(summary_start=start, summary_offset_start=end, summary_crc=0)
        footer.summary_crc = crc32(bytes_of(footer)[:-CRC_BYTES], crc32(section))
        return section + bytes_of(footer)

    def _statistics(self) -> mcap.Statistics:
        return mcap.Statistics(
            attachment_count=self._counts[Opcode.ATTACHMENT_INDEX],
            channel_count=self._counts[Opcode.CHANNEL],
            channel_message_counts=self._message_counts,
            chunk_count=self._counts[Opcode.CHUNK_INDEX],
            message_count=self._message_counts.total(),
            message_end_time=self._latest,
            message_start_time=self._earliest,
            metadata_count=self._counts[Opcode.METADATA_INDEX],
            schema_count=self._counts[Opcode.SCHEMA],
        )
