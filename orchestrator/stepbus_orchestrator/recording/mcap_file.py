"""The MCAP file of a run: MessagePack messages with JSON Schemas, in chunks of whole steps."""

import contextlib
import errno
import json
import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from struct import Struct
from typing import Any

import zstandard
from isal.isal_zlib import crc32
from mcap import records as mcap
from mcap.opcode import Opcode

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.background import Background
from stepbus_orchestrator.recording.locked_file import LockedFile
from stepbus_orchestrator.recording.records import HEAD, MAGIC, STEP_END, bytes_of
from stepbus_orchestrator.recording.summary import Summary
from stepbus_participant import Disk, replaced
from stepbus_schemas import json_schema, reached

_FAILURES = (OSError, MemoryError)
"""What a write that failed raises."""
_MESSAGE = Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_OPCODE = int(Opcode.MESSAGE)
_FIELDS_BYTES = _MESSAGE.size - HEAD.size
_STEP_END = HEAD.pack(STEP_END, 0)
_BIG_BYTES = 64 * 1024
"""A larger message is content of a bulk port: a picture, a point cloud."""
_USUAL, _FAST = 3, -1
"""Levels of compression; that of large messages gives up soon where nothing is to be gained."""
_WORTH_IT = 0.9
"""What is not compressed to so much of its size is stored as it is: readers are spared the work."""
_ENTRY = Struct("<QQ")  # log time, offset in the chunk
_INDEX = Struct("<BQHI")  # opcode, length, channel, length of the entries


class _Chunk:
    """The chunk that is being filled, of whole steps; that of mcap takes four calls a message.

    records: what it holds, in order. indexes: channel → the entries of its messages in the index.
    times: log times of its messages. is_big: whether it has a message of more than `_BIG_BYTES`.
    """

    def __init__(self) -> None:
        self.records = bytearray()
        self.indexes: defaultdict[int, bytearray] = defaultdict(bytearray)
        self.times: list[int] = []
        self.is_big = False


class McapFile:
    """An MCAP file of MessagePack messages with JSON Schemas, and nothing that differs by run.

    It has the bytes that `mcap.writer.Writer` writes, but that each chunk holds whole steps.

    All methods but `flush` raise RecordingFailed when the file cannot be written or is closed.
    After the first failed write nothing but the index is appended: a recording has no hole.

    in_background: whether a thread compresses and writes the chunks; later calls raise what fails
    there. library, profile: of its header. written_as: the name of the file until it gets its own.
    closed: whether the file is complete; nothing can be added to it then.
    """

    chunk_bytes = layout.CHUNK_BYTES

    def __init__(
        self,
        path: Path,
        disk: Disk = os,
        *,
        in_background: bool = False,
        library: str = layout.LIBRARY,
        profile: str = layout.PROFILE,
        written_as: Path | None = None,
    ) -> None:
        self.path = path
        self.closed = False
        self._background = Background(has_thread=in_background)
        self._crc = 0
        self._summary = Summary()
        self._schemas: dict[str, int] = {}
        self._chunk = _Chunk()
        self._step = (0, 0)  # time and sequence of the newest message
        self._unfinished = (0, 0)  # where the chunk will stand, and how much of it does
        self._refusal: RecordingFailed | None = None
        """Why nothing can be added: the first failure, or that the file is closed."""
        with self._translated():
            self._file = LockedFile(written_as or path, disk)
            self._write(MAGIC + bytes_of(mcap.Header(profile, library)))

    # --- what is added --------------------------------------------------------------------

    def attach_scenario(self, scenario: bytes, files: Mapping[str, bytes]) -> None:
        """Attach a scenario, and its files by name."""
        self.attach(layout.SCENARIO_ATTACHMENT, scenario)
        for name, content in files.items():
            self.attach(layout.file_attachment(name), content)

    def attach(self, name: str, data: bytes) -> None:
        """Attach a file."""
        is_scenario = name == layout.SCENARIO_ATTACHMENT
        media_type = "application/yaml" if is_scenario else "application/octet-stream"
        self._add_record(mcap.Attachment(0, 0, name, media_type, data))

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._add_record(mcap.Metadata(name, dict(content)))

    def _add_record(self, record: mcap.Attachment | mcap.Metadata) -> None:
        with self._translated():
            offset, data = self._file.position, bytes_of(record)
            at, known = self._unfinished
            if at == offset and known:
                # What it replaces follows it again: a kill loses nothing.
                self._write(data, ahead=bytes(self._chunk.records[:known]) + _STEP_END)
                self._unfinished = (self._file.position, known)
            else:
                self._write(data)
            self._summary.add(record, offset, len(data))

    def add_channel(
        self,
        topic: str,
        type_name: str,
        metadata: Mapping[str, str],
        schema_of: Callable[[str], Mapping[str, Any]] = json_schema,
    ) -> int:
        """Register a channel and, once, its type's JSON Schema; return the channel's number."""
        if type_name not in self._schemas:
            text = json.dumps(schema_of(type_name), sort_keys=True, ensure_ascii=False)
            name, encoding = layout.schema_name(type_name), layout.SCHEMA_ENCODING
            schema = mcap.Schema(id=0, name=name, encoding=encoding, data=text.encode())
            self._schemas[type_name] = self.register(schema)
        channel = mcap.Channel(
            id=0,
            topic=topic,
            message_encoding=layout.MESSAGE_ENCODING,
            metadata=dict(metadata),
            schema_id=self._schemas[type_name],
        )
        return self.register(channel)

    def register(self, record: mcap.Schema | mcap.Channel) -> int:
        """Add a schema or a channel, under the next free number; return that."""
        with self._translated():
            number, data = self._summary.register(record)
            self._chunk.records += data
            if len(self._chunk.records) > self.chunk_bytes:
                self._end_chunk()
        return number

    def add(self, channel: int, t_ns: int, data: bytes, sequence: int) -> None:
        """Write one message."""
        self.add_all([(channel, data)], t_ns, sequence)

    def add_all(self, messages: Sequence[tuple[int, bytes]], t_ns: int, sequence: int) -> None:
        """Write messages of one time, (channel, content) each, in their order.

        A chunk is full when it has `chunk_bytes` and the next message is of another step.
        """
        if not messages:
            # No participant has published at this step: its time is no part of the chunk.
            return
        # Called for every step: the context manager would take longer than the rest.
        if self._refusal is not None:
            raise self._refusal
        try:
            if (t_ns, sequence) != self._step:
                if len(self._chunk.records) > self.chunk_bytes:
                    self._end_chunk()
                self._step = (t_ns, sequence)
            chunk = self._chunk
            chunk.times.append(t_ns)
            records, indexes, pack = chunk.records, chunk.indexes, _MESSAGE.pack
            for channel, data in messages:
                indexes[channel] += _ENTRY.pack(t_ns, len(records))
                size = _FIELDS_BYTES + len(data)
                records += pack(_OPCODE, size, channel, sequence, t_ns, t_ns)
                records += data
                if size > _BIG_BYTES:
                    chunk.is_big = True
        except _FAILURES as exc:
            raise self.refuse(exc) from exc

    def flush(self) -> None:
        """Write all messages, so that the file has them even after a kill; it raises nothing.

        To be called between steps, whose end it marks. What is new in the open chunk is written
        after the file's end, record by record and not compressed; the whole chunk replaces it. So
        the bytes of the closed file stay the same.
        """
        if self._refusal is not None:
            return
        try:
            self._background.settle()
            chunk, offset = self._chunk, self._file.position
            if not chunk.indexes:
                return
            known = self._unfinished[1] if self._unfinished[0] == offset else 0
            # Where there is no room now, the next try begins with what is missing: no hole stays.
            if self._file.write_ahead(bytes(chunk.records[known:]) + _STEP_END):
                self._unfinished = (offset, len(chunk.records))
        except _FAILURES as exc:
            # Of a chunk that was being compressed: whatever comes next is refused.
            self.refuse(exc)

    # --- its end --------------------------------------------------------------------------

    def close(self, incomplete: Mapping[str, str] | None = None) -> None:
        """Write what is left, a last metadata record and the index; harmless when repeated.

        incomplete: content of that record, which is written only where all messages are.
        On a full disk they go into the room that was set aside. Raises RecordingFailed when they
        cannot be written all the same, or anything before could not.
        """
        if self.closed:
            return
        self.closed = True
        try:
            self._background.settle()
        except _FAILURES as exc:
            self.refuse(exc)
        failure = self._refusal
        self._file.release()
        try:
            if failure is not None:
                self._chunk, incomplete = _Chunk(), None
            self._finish(incomplete)
        except _FAILURES as exc:
            raise self.refuse(exc) from exc
        finally:
            self._background.end()
            self._file.close()
            closed = f"the recording {self.path} is closed; nothing can be added to it"
            self._refusal = failure or RecordingFailed(closed)
        if failure is not None:
            raise failure

    def _finish(self, incomplete: Mapping[str, str] | None) -> None:
        """Write the last chunk, a last record and the index."""
        if self._chunk.indexes:
            self._write_chunk(self._chunk)
        if incomplete is not None:
            self.add_metadata(layout.INCOMPLETE_METADATA, incomplete)
        self._write(bytes_of(mcap.DataEnd(self._crc)))
        self._write(self._summary.end(self._file.position) + MAGIC)

    def check(self) -> None:
        """Raise RecordingFailed when the closed file is not, byte for byte, what was written."""
        try:
            is_whole = self._file.holds(self._crc)
        except _FAILURES as exc:
            raise _failure(self.path, exc) from exc
        if not is_whole:
            reached("a recording was changed or removed")
            raise RecordingFailed(
                f"the recording {self.path} was changed or removed by another process during the "
                "run; run again, and do not change the run's folder until the run ends"
            )

    # --- how it is written ----------------------------------------------------------------

    def _write(self, data: bytes, ahead: bytes = b"") -> None:
        self._file.write(data, ahead)
        self._crc = crc32(data, self._crc)

    def _end_chunk(self) -> None:
        """Begin a new chunk; raises OSError and MemoryError of the one before."""
        chunk = self._chunk
        if chunk.indexes:
            if self._summary.chunk_index_bytes:
                self._background.start(partial(self._write_chunk, chunk))
            else:
                # A short run is over before a thread would pay.
                self._write_chunk(chunk)
            self._chunk = _Chunk()

    def _write_chunk(self, chunk: _Chunk) -> None:
        """Write a chunk and its message indexes at once; raises OSError and MemoryError."""
        self._file.keep_room(self._summary.chunk_index_bytes)
        data, row = _encode_chunk(chunk, self._file.position)
        self._write(data)
        self._summary.add_chunk(chunk.indexes, row)

    # --- failures -------------------------------------------------------------------------

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        if self._refusal is not None:
            raise self._refusal
        try:
            self._background.settle()
            yield
        except _FAILURES as exc:
            raise self.refuse(exc) from exc

    def refuse(self, exc: OSError | MemoryError) -> RecordingFailed:
        """Return the first failure, which refuses all that comes next."""
        reached("a recording cannot be written")
        self._refusal = self._refusal or _failure(self.path, exc)
        return self._refusal


def _encode_chunk(chunk: _Chunk, start: int) -> tuple[bytes, mcap.ChunkIndex]:
    """Return the bytes of a chunk with its message indexes, and its record of the summary.

    start: where it begins in the file [bytes]. Raises MemoryError.
    """
    content = bytes(chunk.records)
    packed, compression = _compressed(content, _FAST if chunk.is_big else _USUAL), "zstd"
    if chunk.is_big and len(packed) > _WORTH_IT * len(content):
        packed, compression = content, ""
    earliest, latest = min(chunk.times), max(chunk.times)
    record = bytes_of(
        mcap.Chunk(compression, packed, latest, earliest, crc32(content), len(content))
    )
    indexes, offsets = bytearray(), {}
    for channel, entries in chunk.indexes.items():
        offsets[channel] = start + len(record) + len(indexes)
        indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, len(entries) + 6, channel, len(entries))
        indexes += entries
    row = mcap.ChunkIndex(
        chunk_length=len(record),
        chunk_start_offset=start,
        compression=compression,
        compressed_size=len(packed),
        message_end_time=latest,
        message_index_length=len(indexes),
        message_index_offsets=offsets,
        message_start_time=earliest,
        uncompressed_size=len(content),
    )
    return record + indexes, row


def _compressed(content: bytes, level: int) -> bytes:
    try:
        return zstandard.ZstdCompressor(level).compress(content)
    except zstandard.ZstdError as exc:
        # Whatever the content, it lacks nothing but memory.
        raise MemoryError(str(exc)) from exc


def _failure(path: Path, exc: OSError | MemoryError) -> RecordingFailed:
    """Return the error for a write that failed, with what the user can do."""
    if isinstance(exc, MemoryError):
        return RecordingFailed(
            f"the recording {path} cannot be written: the orchestrator has no memory "
            "left; free some memory or raise its limit (ulimit -v)"
        )
    remedy = (
        "raise the file size limit (ulimit -f)"
        if exc.errno == errno.EFBIG
        else "free some disk space or choose another folder with --out"
    )
    return RecordingFailed(
        f"the recording {path} cannot be written: {exc.strerror or exc}; {remedy}"
    )


@contextlib.contextmanager
def whole_file(path: Path, disk: Disk = os, **header: Any) -> Iterator[McapFile]:
    """Yield a file that replaces `path` at the end, if nothing has failed; else nothing is left.

    header: as of `McapFile`. Raises RecordingFailed when it cannot be written.
    """
    try:
        # It may replace the only copy there is.
        with (
            replaced(path, disk, syncs=True) as part,
            contextlib.closing(McapFile(path, disk, written_as=part, **header)) as file,
        ):
            yield file
    except RecordingFailed:
        raise
    except OSError as exc:
        raise _failure(path, exc) from exc
