"""Writes the records of an MCAP file: chunks of whole steps, and the index behind them."""

import dataclasses
import zlib
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from struct import Struct
from typing import Any

from isal.isal_zlib import crc32, crc32_combine
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chunk import BIG_BYTES, Chunk, Encoded, encode_chunk
from stepbus_orchestrator.recording.records import CRC_BYTES, HEAD, MAGIC, STEP_END
from stepbus_orchestrator.recording.workers import Workers

_MESSAGE = Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_FIELDS_BYTES = _MESSAGE.size - HEAD.size
_STEP_END = HEAD.pack(STEP_END, 0)
_GROUPS = (
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
)
"""What the summary section consists of, in its order."""


class MessageWriter:
    """Writes the bytes that `mcap.writer.Writer` writes, but that each chunk holds whole steps.

    Chunks with big messages are compressed in threads, and written in their order a few chunks
    later. crc: of all that is in the file.

    output: takes each `write` and `writelines` as a whole, or raises OSError and has nothing of it;
    what it refused is not in the index either. keep_room: is told the size of the index [bytes]
    before a chunk adds to it; may raise OSError.
    """

    def __init__(
        self,
        output: Any,
        *,
        library: str = layout.LIBRARY,
        profile: str = layout.PROFILE,
        chunk_size: int = layout.CHUNK_BYTES,
        keep_room: Callable[[int], None] = lambda _size: None,
    ) -> None:
        self._output = output
        self._chunk_size = chunk_size
        self._keep_room = keep_room
        self.crc = 0
        self._summary = {opcode: bytearray() for opcode in _GROUPS}
        self._counts: Counter[Opcode] = Counter()
        # The index records of all chunks are packed: the memory of a run must not grow with it.
        self._index_packer = zlib.compressobj(1)
        self._index_bytes = 0
        self._chunk = Chunk()
        self._workers: Workers[Encoded] | None = None
        self._message_counts: Counter[int] = Counter()
        self._earliest = self._latest = 0
        self._step = (0, 0)  # time and sequence of the newest message
        self._unfinished = (0, 0)  # where the chunk will stand, and how much of it does
        self._write(MAGIC + _bytes_of(mcap.Header(profile, library)))

    def register(self, record: mcap.Schema | mcap.Channel) -> int:
        """Add a schema or a channel to the chunk, under the next free number; return that."""
        opcode = Opcode.SCHEMA if isinstance(record, mcap.Schema) else Opcode.CHANNEL
        self._counts[opcode] += 1
        data = _bytes_of(dataclasses.replace(record, id=self._counts[opcode]))
        self._summary[opcode] += data
        self._chunk.records.append(data)
        self._chunk.size += len(data)
        if self._chunk.size > self._chunk_size:
            self._end_chunk()
        return self._counts[opcode]

    def add(self, record: mcap.Attachment | mcap.Metadata) -> None:
        """Write an attachment or a metadata record."""
        self._drain()
        offset, data = self._output.tell(), _bytes_of(record)
        at, known = self._unfinished
        if at == offset and known:
            # Behind it stands again what it replaces: a kill loses nothing.
            self._output.write(data, self._chunk.content()[:known] + _STEP_END)
            self.crc = crc32(data, self.crc)
            self._unfinished = (self._output.tell(), known)
        else:
            self._write(data)
        if isinstance(record, mcap.Metadata):
            self._add_index(
                Opcode.METADATA_INDEX, mcap.MetadataIndex(offset, len(data), record.name)
            )
            return
        index = mcap.AttachmentIndex(
            offset=offset,
            length=len(data),
            log_time=record.log_time,
            create_time=record.create_time,
            data_size=len(record.data),
            name=record.name,
            media_type=record.media_type,
        )
        self._add_index(Opcode.ATTACHMENT_INDEX, index)

    def _add_index(self, opcode: Opcode, index: mcap.McapRecord) -> None:
        self._summary[opcode] += _bytes_of(index)
        self._counts[opcode] += 1

    def add_messages(
        self,
        messages: Iterable[tuple[int, bytes]],
        log_time: int,
        publish_time: int,
        sequence: int = 0,
    ) -> None:
        """Append messages of one time, (channel, content) each, to the chunk.

        A chunk is full when it has `chunk_size` bytes and the next message is of another step.
        Raises OSError when a full one cannot be written.
        """
        if (log_time, sequence) != self._step:
            if self._chunk.size > self._chunk_size:
                self._end_chunk()
            self._step = (log_time, sequence)
        chunk, pack = self._chunk, _MESSAGE.pack
        if not chunk.indexes:
            chunk.earliest = chunk.latest = log_time
        elif log_time > chunk.latest:
            chunk.latest = log_time
        elif log_time < chunk.earliest:
            chunk.earliest = log_time
        records, indexes, size = chunk.records, chunk.indexes, chunk.size
        for channel, data in messages:
            index = indexes.get(channel)
            if index is None:
                index = indexes[channel] = []
            index += (log_time, size)
            length = _FIELDS_BYTES + len(data)
            head = pack(Opcode.MESSAGE, length, channel, sequence, log_time, publish_time)
            if length > BIG_BYTES:
                chunk.is_big = True
                records += (head, data)
            else:
                records.append(head + data)
            size += HEAD.size + length
        chunk.size = size

    def write_unfinished(self) -> None:
        """Write what is new in the open chunk behind the file's end; the whole chunk replaces it.

        The records stand there one by one, not compressed: a file that is cut off behind them has
        them, and one that is closed has the same bytes as without. To be called between steps.
        """
        self._drain()
        chunk, offset = self._chunk, self._output.tell()
        if not chunk.indexes:
            return
        known = self._unfinished[1] if self._unfinished[0] == offset else 0
        new = memoryview(chunk.content())[known:]
        # Where there is no room now, the next try begins with what is missing: no hole stays.
        if self._output.write_ahead(b"".join((new, _STEP_END))):
            self._unfinished = (offset, chunk.size)

    def drop_chunks(self) -> None:
        """Forget the messages that are not in the file yet."""
        self._chunk = Chunk()
        self._end_workers()

    def settle(self) -> None:
        """Write all chunks with big messages, the open one too; raises OSError."""
        if self._chunk.is_big:
            self._end_chunk()
        self._drain()

    def finish(self, last: mcap.Metadata | None = None) -> None:
        """Write the last chunk, behind it a last record, and the index."""
        self._end_chunk()
        self._drain()
        self._end_workers()
        if last is not None:
            self.add(last)
        self._write(_bytes_of(mcap.DataEnd(self.crc)))
        self._summary[Opcode.STATISTICS] += _bytes_of(self._statistics())
        chunk_indexes = self._summary[Opcode.CHUNK_INDEX] + self._index_packer.flush()
        self._summary[Opcode.CHUNK_INDEX] = bytearray(zlib.decompress(chunk_indexes))
        start = end = self._output.tell()
        offsets = []
        for opcode, records in self._summary.items():
            offsets.append(mcap.SummaryOffset(opcode, end, len(records)))
            end += len(records)
        summary = b"".join((*self._summary.values(), _bytes_of(*offsets)))
        footer = mcap.Footer(summary_start=start, summary_offset_start=end, summary_crc=0)
        footer.summary_crc = crc32(_bytes_of(footer)[:-CRC_BYTES], crc32(summary))
        self._write(summary + _bytes_of(footer) + MAGIC)

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

    def _write(self, data: bytes) -> None:
        self._output.write(data)
        self.crc = crc32(data, self.crc)

    def _drain(self) -> None:
        if self._workers is not None:
            self._workers.drain()

    def _end_workers(self) -> None:
        if self._workers is not None:
            self._workers.close()
            self._workers = None

    def _end_chunk(self) -> None:
        """Hand on the chunk, to be written; raises OSError where it, or one before, cannot be.

        It is kept until it is encoded: that may raise MemoryError.
        """
        chunk = self._chunk
        if not chunk.indexes:
            return
        if chunk.is_big and self._workers is None:
            self._workers = Workers(self._put)
        workers = self._workers
        if workers is not None and (chunk.is_big or workers.are_busy):
            workers.give(partial(encode_chunk, chunk), chunk.size)
            self._chunk = Chunk()
        else:
            encoded = encode_chunk(chunk)
            self._chunk = Chunk()
            self._put(encoded)

    def _put(self, encoded: Encoded) -> None:
        """Write a chunk and its message indexes at once; raises OSError, and has lost them."""
        start = self._output.tell()
        self._keep_room(self._index_bytes)
        self._output.writelines(encoded.parts)
        self.crc = crc32_combine(self.crc, encoded.crc, encoded.size)
        self._count(encoded.chunk, encoded.row(start))

    def _count(self, chunk: Chunk, index: bytes) -> None:
        """Add a chunk to the summary, once it is in the file."""
        is_first = not self._counts[Opcode.CHUNK_INDEX]
        self._earliest = chunk.earliest if is_first else min(self._earliest, chunk.earliest)
        self._latest = max(self._latest, chunk.latest)
        for channel, entries in chunk.indexes.items():
            self._message_counts[channel] += len(entries) // 2
        self._counts[Opcode.CHUNK_INDEX] += 1
        self._index_bytes += len(index)
        self._summary[Opcode.CHUNK_INDEX] += self._index_packer.compress(index)


def _bytes_of(*records: mcap.McapRecord) -> bytes:
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data
