"""The chunk of an MCAP file: records of whole steps, compressed, and where in it they are."""

import threading
from collections.abc import Iterable, Iterator
from itertools import groupby
from struct import Struct
from typing import NamedTuple

import zstandard
from isal.isal_zlib import crc32, crc32_combine
from mcap import records as mcap
from mcap.opcode import Opcode

from stepbus_orchestrator.recording.records import HEAD, bytes_of

BIG_BYTES = 64 * 1024
"""A larger message is content of a bulk port: a picture, a point cloud."""
_FAST = -1
"""The level of compression for these: it gives up soon where nothing is to be gained."""
_WORTH_IT = 0.9
"""What is not compressed to so much of its size is stored as it is: readers are spared the work."""
_SAMPLES, _SAMPLE_BYTES = 8, 4096
"""So many parts of a chunk with big messages say whether it is worth it to compress all of it."""

_SIZE = Struct("<Q")
_INDEX = Struct("<BQHI")  # opcode, length, channel, length of the entries


class Chunk:
    """The chunk that is being filled; the builder of mcap calls four functions for each message.

    records: what it holds, in order, some in two pieces. size: of these [bytes]. indexes: channel →
    log time and offset of each of its messages, one behind the other. is_big: whether it has a
    message of more than `BIG_BYTES`.
    """

    def __init__(self) -> None:
        self.records: list[bytes] = []
        self.size = 0
        self.indexes: dict[int, list[int]] = {}
        self.is_big = False

    def content(self) -> bytes:
        """Return all records, one behind the other."""
        whole = b"".join(self.records)
        self.records = [whole]
        return whole


class Encoded(NamedTuple):
    """A chunk as it stands in a file: its bytes in parts, with the message indexes behind it.

    crc, size: of all parts. row: its record of the summary, with offsets from its beginning.
    """

    chunk: Chunk
    parts: list[bytes]
    crc: int
    size: int
    row: mcap.ChunkIndex


def encode_chunk(chunk: Chunk) -> Encoded:
    """Return the bytes of a chunk: a function of its messages alone; raises MemoryError."""
    compressor = _own.fast if chunk.is_big else _own.usual
    content, crc = list(_gathered(chunk.records)), 0
    for part in content:
        crc = crc32(part, crc)
    packed, compression, packed_size = content, "", chunk.size
    if not chunk.is_big or _gains(_sample(content, chunk.size), compressor):
        whole = _compressed(b"".join(content), compressor)
        if not chunk.is_big or len(whole) <= _WORTH_IT * chunk.size:
            packed, compression, packed_size = [whole], "zstd", len(whole)
    times = [t_ns for entries in chunk.indexes.values() for t_ns in entries[::2]]
    earliest, latest = min(times), max(times)
    record = mcap.Chunk(compression, b"", latest, earliest, crc, chunk.size)
    head = bytearray(bytes_of(record))
    # The bytes that belong here are other parts: they are not copied.
    _SIZE.pack_into(head, 1, len(head) - HEAD.size + packed_size)
    _SIZE.pack_into(head, len(head) - _SIZE.size, packed_size)
    indexes, offsets = bytearray(), {}
    for channel, entries in chunk.indexes.items():
        offsets[channel] = len(head) + packed_size + len(indexes)
        numbers = Struct(f"<{len(entries)}Q").pack(*entries)
        indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, len(numbers) + 6, channel, len(numbers))
        indexes += numbers
    row = mcap.ChunkIndex(
        chunk_length=len(head) + packed_size,
        chunk_start_offset=0,
        compression=compression,
        compressed_size=packed_size,
        message_end_time=latest,
        message_index_length=len(indexes),
        message_index_offsets=offsets,
        message_start_time=earliest,
        uncompressed_size=chunk.size,
    )
    # The checksum of what is stored as it is has been computed already.
    packed_crc = crc32(packed[0]) if compression else crc
    return Encoded(
        chunk=chunk,
        parts=[bytes(head), *packed, bytes(indexes)],
        crc=crc32(indexes, crc32_combine(crc32(head), packed_crc, packed_size)),
        size=row.chunk_length + len(indexes),
        row=row,
    )


class _Compressors(threading.local):
    """Those of this thread: making one takes longer than compressing a sample."""

    def __init__(self) -> None:
        self.fast = zstandard.ZstdCompressor(_FAST)
        self.usual = zstandard.ZstdCompressor()


_own = _Compressors()


def _gathered(records: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the same bytes in fewer parts: only what is small is copied."""
    for is_big, group in groupby(records, lambda record: len(record) > BIG_BYTES):
        if is_big:
            yield from group
        else:
            yield b"".join(group)


def _sample(content: Iterable[bytes], size: int) -> bytes:
    """Return samples of bytes in parts, wherever one part ends and the next begins."""
    starts, at, found = [size * number // _SAMPLES for number in range(_SAMPLES)], 0, []
    for part in content:
        for start in starts:
            if start < at + len(part) and start + _SAMPLE_BYTES > at:
                found += [part[max(0, start - at) : start + _SAMPLE_BYTES - at]]
        at += len(part)
    return b"".join(found)


def _gains(sample: bytes, compressor: zstandard.ZstdCompressor) -> bool:
    return len(_compressed(sample, compressor)) <= _WORTH_IT * len(sample)


def _compressed(content: bytes, compressor: zstandard.ZstdCompressor) -> bytes:
    try:
        return compressor.compress(content)
    except zstandard.ZstdError as exc:
        # Whatever the content, it lacks nothing but memory.
        raise MemoryError(str(exc)) from exc
