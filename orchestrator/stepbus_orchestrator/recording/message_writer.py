"""The chunk of an MCAP file that is still being filled."""

import contextlib
import zlib
from collections.abc import Callable, Iterable, Iterator
from struct import Struct
from typing import Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.writer import CompressionType, IndexType, Writer

from stepbus_orchestrator.recording.records import HEAD, STEP_END

_INDEX = Struct("<BQHI")  # opcode, length, channel, length of the entries
_NUMBER_BYTES = 8


class OpenChunk:
    """Takes the place of the chunk builder of mcap, which calls four functions for each message.

    records: what the chunk holds, in order. count: their size [bytes]. indexes: channel → log
    time and offset of each of its messages, one behind the other. earliest, latest: log times.
    """

    def __init__(self) -> None:
        self.records: list[bytes] = []
        self.count = 0
        self.indexes: dict[int, list[int]] = {}
        self.earliest = self.latest = 0

    def reset(self) -> None:
        """Forget all records."""
        self.records = []
        self.count = 0
        self.indexes = {}

    def add_schema(self, schema: Schema) -> None:
        """Append a schema."""
        self._append(schema)

    def add_channel(self, channel: Channel) -> None:
        """Append a channel."""
        self._append(channel)

    def _append(self, record: Schema | Channel) -> None:
        builder: Any = RecordBuilder()
        record.write(builder)
        data: bytes = builder.end()
        self.records.append(data)
        self.count += len(data)

    def cover(self, log_time: int) -> None:
        """Let the times of the chunk include that of the messages that come next."""
        if not self.indexes:
            self.earliest = self.latest = log_time
        elif log_time > self.latest:
            self.latest = log_time
        elif log_time < self.earliest:
            self.earliest = log_time

    def content(self) -> bytes:
        """Return all records, one behind the other."""
        whole = b"".join(self.records)
        self.records = [whole]
        return whole

    def message_counts(self) -> dict[int, int]:
        """Return channel → number of its messages."""
        return {channel: len(entries) // 2 for channel, entries in self.indexes.items()}

    def index_records(self) -> dict[int, bytes]:
        """Return channel → its MessageIndex record."""
        return {channel: _record(channel, entries) for channel, entries in self.indexes.items()}


def _record(channel: int, entries: list[int]) -> bytes:
    size = len(entries) * _NUMBER_BYTES
    head = _INDEX.pack(Opcode.MESSAGE_INDEX, size + 6, channel, size)
    return head + Struct(f"<{len(entries)}Q").pack(*entries)


_MESSAGE = Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_STEP_END = HEAD.pack(STEP_END, 0)
_PREFIX_BYTES = 9  # opcode and length
_FIELDS_BYTES = _MESSAGE.size - _PREFIX_BYTES


def _taken(builder: Any) -> bytes:
    """Return what a builder holds, and empty it."""
    data: bytes = builder.end()
    return data


class _ChunkIndexes:
    """The index records of all chunks, packed: the memory of a run must not grow with it.

    size: of all records in the file [bytes].
    """

    def __init__(self) -> None:
        self.size = 0
        self._compressor = zlib.compressobj()
        self._packed = bytearray()

    def add(self, index: ChunkIndex) -> None:
        """Append the record of one more chunk."""
        builder = RecordBuilder()
        index.write(builder)
        record = _taken(builder)
        self.size += len(record)
        self._packed += self._compressor.compress(record)

    def write(self, stream: RecordBuilder) -> None:
        """Append all records; to be called once."""
        stream.write(zlib.decompress(self._packed + self._compressor.flush()))


class _Checksummed:
    """An output with the checksum of all that was written to it; a failed write adds nothing."""

    def __init__(self, output: Any) -> None:
        self._output = output
        self.tell = output.tell
        self.crc = 0

    def write(self, data: bytes) -> int:
        """Append bytes; raises OSError."""
        count: int = self._output.write(data)
        self.crc = zlib.crc32(data, self.crc)
        return count


class MessageWriter(Writer):
    """Writes what `Writer` writes; what a full disk refuses leaves no trace in the index.

    compression: zstd or none. keep_room: is told the size of the index [bytes] before a chunk adds
    to it; may raise OSError. It relies on how mcap keeps its chunk and its statistics, hence on
    the version that constraints.txt pins. Chunking must be on.
    """

    def __init__(self, output: Any, **options: Any) -> None:
        checked: Any = _Checksummed(output)
        super().__init__(checked, **options)
        self.keep_room: Callable[[int], None] = lambda _size: None
        own = vars(self)
        self._output = output
        self._checked: _Checksummed = checked
        self._compression: CompressionType = own["_Writer__compression"]
        self._compressor = zstandard.ZstdCompressor()
        self._chunk = own["_Writer__chunk_builder"] = OpenChunk()
        self._chunk_bytes: int = own["_Writer__chunk_size"]
        self._statistics: Any = own["_Writer__statistics"]
        self._records: RecordBuilder = own["_Writer__record_builder"]
        self._attached = (own["_Writer__attachment_indexes"], own["_Writer__metadata_indexes"])
        self._step = (0, 0)  # time and sequence of the newest message
        self._unfinished = (0, 0)  # where the chunk will stand, and how much of it does
        self._chunk_indexes = _ChunkIndexes()
        if own["_Writer__index_types"] & IndexType.CHUNK:
            own["_Writer__chunk_indices"].append(self._chunk_indexes)

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Append a message to the chunk; raises OSError when a full one cannot be written.

        A chunk is full when it has `chunk_size` bytes and the next message is of another step.
        """
        self.add_messages([(channel_id, data)], log_time, publish_time, sequence)

    def add_messages(
        self,
        messages: Iterable[tuple[int, bytes]],
        log_time: int,
        publish_time: int,
        sequence: int = 0,
    ) -> None:
        """Append messages of one time, (channel, content) each; raises as `add_message` does."""
        chunk, pack, step = self._chunk, _MESSAGE.pack, (log_time, sequence)
        if step != self._step:
            if chunk.count > self._chunk_bytes:
                self._end_chunk()
            self._step = step
        chunk.cover(log_time)
        records, indexes, count = chunk.records, chunk.indexes, chunk.count
        for channel, data in messages:
            index = indexes.get(channel)
            if index is None:
                index = indexes[channel] = []
            index += (log_time, count)
            length = _FIELDS_BYTES + len(data)
            head = pack(Opcode.MESSAGE, length, channel, sequence, log_time, publish_time)
            records.append(head + data)
            count += _PREFIX_BYTES + length
        chunk.count = count

    def add_attachment(self, *args: Any, **named: Any) -> None:
        """Write an attachment; raises OSError, and has not counted it, when it cannot be."""
        with self._whole():
            super().add_attachment(*args, **named)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record; raises OSError, and has not counted it, when it cannot be."""
        with self._whole():
            super().add_metadata(name, data)

    def write_unfinished(self) -> None:
        """Write what is new in the open chunk behind the file's end; the whole chunk replaces it.

        The records stand there one by one, not compressed: a file that is cut off behind them has
        them, and one that is closed has the same bytes as without. To be called between steps.
        """
        chunk, offset = self._chunk, self._output.tell()
        if not chunk.indexes:
            return
        known = self._unfinished[1] if self._unfinished[0] == offset else 0
        # Where there is no room now, the next try begins with what is missing: no hole stays.
        if self._output.write_ahead(chunk.content()[known:] + _STEP_END):
            self._unfinished = (offset, chunk.count)

    def drop_chunk(self) -> None:
        """Forget the messages that are not in the file yet."""
        self._chunk.reset()

    @contextlib.contextmanager
    def _whole(self) -> Iterator[None]:
        counts, lengths = self._statistics, [len(rows) for rows in self._attached]
        before = (counts.attachment_count, counts.metadata_count)
        try:
            yield
        except OSError:
            counts.attachment_count, counts.metadata_count = before
            for rows, length in zip(self._attached, lengths, strict=True):
                del rows[length:]
            _taken(self._records)
            raise

    def _end_chunk(self) -> None:
        """Write the chunk and its message indexes at once; raises OSError, and has lost them."""
        chunk = self._chunk
        if not chunk.indexes:
            self._keep_checksum()
            return
        try:
            record = self._chunk_record()
            offset, builder = self._output.tell(), RecordBuilder()
            record.write(builder)
            index = ChunkIndex(
                message_start_time=record.message_start_time,
                message_end_time=record.message_end_time,
                chunk_start_offset=offset,
                chunk_length=builder.count,
                message_index_offsets={},
                message_index_length=0,
                compression=record.compression,
                compressed_size=len(record.data),
                uncompressed_size=record.uncompressed_size,
            )
            for channel, entries in chunk.index_records().items():
                index.message_index_offsets[channel] = offset + builder.count
                builder.write(entries)
            index.message_index_length = builder.count - index.chunk_length
            self.keep_room(self._chunk_indexes.size)
            self._checked.write(_taken(builder))
            self._count()
            self._chunk_indexes.add(index)
        finally:
            chunk.reset()
            self._keep_checksum()

    def _keep_checksum(self) -> None:
        """Let `finish`, which ends the last chunk first, write the checksum of the data section."""
        vars(self)["_Writer__data_section_crc"] = self._checked.crc

    # Whatever of `Writer` ends a chunk, ends it so.
    _Writer__finalize_chunk = _end_chunk

    def _chunk_record(self) -> Chunk:
        chunk = self._chunk
        data = chunk.content()
        is_packed = self._compression == CompressionType.ZSTD
        return Chunk(
            compression="zstd" if is_packed else "",
            data=self._compressor.compress(data) if is_packed else data,
            message_start_time=chunk.earliest,
            message_end_time=chunk.latest,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )

    def _count(self) -> None:
        """Add the chunk to the statistics, once it is in the file."""
        chunk, statistics = self._chunk, self._statistics
        if statistics.message_count == 0 or chunk.earliest < statistics.message_start_time:
            statistics.message_start_time = chunk.earliest
        statistics.message_end_time = max(statistics.message_end_time, chunk.latest)
        for channel, count in chunk.message_counts().items():
            statistics.channel_message_counts[channel] += count
            statistics.message_count += count
        statistics.chunk_count += 1
