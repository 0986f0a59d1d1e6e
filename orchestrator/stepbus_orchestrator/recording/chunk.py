"""The chunk of an MCAP file: records of whole steps, compressed, and where in it they are."""

import threading
from collections.abc import Iterable, Iterator
from itertools import groupby
from struct import Struct
from typing import NamedTuple

import zstandard
from isal.isal_zlib import crc32, crc32_combine
from mcap.opcode import Opcode

BIG_BYTES = 64 * 1024
"""A larger message is content of a bulk port: a picture, a point cloud."""
_FAST = -1
"""The level of compression for these: it gives up soon where nothing is to be gained."""
_WORTH_IT = 0.9
"""What is not compressed to so much of its size is stored as it is: readers are spared the work."""
_SAMPLES, _SAMPLE_BYTES = 8, 4096
"""So many parts of a chunk with big messages say whether it is worth it to compress all of it."""

_CHUNK = Struct("<BQQQQI")  # opcode, length, two times, size and CRC of what it holds
_SIZE = Struct("<Q")
_TEXT = Struct("<I")
_INDEX = Struct("<BQHI")  # opcode, length, channel, length of the entries
_ROW = Struct("<BQQQQQI")  # opcode, length, two times, offset and length, size of the map
_PLACE = Struct("<HQ")  # channel, offset of its message index
_ROW_END = Struct("<QI")  # bytes of all message indexes, length of the name
_SIZES = Struct("<QQ")  # compressed, uncompressed
_HEAD_BYTES = 9
"""Opcode and length, which do not count as the record's own length."""


class Chunk:
    """The chunk that is being filled; the builder of mcap calls four functions for each message.

    records: what it holds, in order, some in two pieces. size: of these [bytes]. indexes: channel →
    log time and offset of each of its messages, one behind the other. earliest, latest: log times.
    is_big: whether it has a message of more than `BIG_BYTES`.
    """

    def __init__(self) -> None:
        self.records: list[bytes] = []
        self.size = 0
        self.indexes: dict[int, list[int]] = {}
        self.earliest = self.latest = 0
        self.is_big = False

    def content(self) -> bytes:
        """Return all records, one behind the other."""
        whole = b"".join(self.records)
        self.records = [whole]
        return whole


class Encoded(NamedTuple):
    """A chunk as it stands in a file: its bytes in parts, with the message indexes behind it.

    crc, size: of all parts. length, compression, packed_size: of the chunk itself. offsets: channel
    → where its message index is, from the beginning of the chunk on.
    """

    chunk: Chunk
    parts: list[bytes]
    crc: int
    size: int
    length: int
    compression: str
    packed_size: int
    offsets: dict[int, int]

    def row(self, start: int) -> bytes:
        """Return its record of the index; start: where it begins in the file."""
        chunk, name = self.chunk, self.compression.encode()
        places = b"".join(_PLACE.pack(c, start + offset) for c, offset in self.offsets.items())
        size = _ROW.size - _HEAD_BYTES + len(places) + _ROW_END.size + len(name) + _SIZES.size
        return b"".join(
            (
                _ROW.pack(
                    *(Opcode.CHUNK_INDEX, size, chunk.earliest, chunk.latest),
                    *(start, self.length, len(places)),
                ),
                places,
                _ROW_END.pack(self.size - self.length, len(name)),
                name,
                _SIZES.pack(self.packed_size, chunk.size),
            )
        )


def encode_chunk(chunk: Chunk) -> Encoded:
    """Return the bytes of a chunk: a function of its messages alone; raises MemoryError."""
    compressor = _compressor(is_big=chunk.is_big)
    content, crc = list(_gathered(chunk.records)), 0
    for part in content:
        crc = crc32(part, crc)
    packed, compression = content, ""
    if not chunk.is_big or _gains(_sample(content, chunk.size), compressor):
        whole = _compressed(b"".join(content), compressor)
        if not chunk.is_big or len(whole) <= _WORTH_IT * chunk.size:
            packed, compression = [whole], "zstd"
    packed_size = len(packed[0]) if compression else chunk.size
    name = _TEXT.pack(len(compression)) + compression.encode()
    length = _CHUNK.size - _HEAD_BYTES + len(name) + _SIZE.size + packed_size
    head = _CHUNK.pack(Opcode.CHUNK, length, chunk.earliest, chunk.latest, chunk.size, crc)
    head += name + _SIZE.pack(packed_size)
    indexes, offsets = bytearray(), {}
    for channel, entries in chunk.indexes.items():
        offsets[channel] = len(head) + packed_size + len(indexes)
        numbers = Struct(f"<{len(entries)}Q").pack(*entries)
        indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, len(numbers) + 6, channel, len(numbers))
        indexes += numbers
    # The checksum of what is stored as it is has been computed already.
    packed_crc = crc32(packed[0]) if compression else crc
    return Encoded(
        chunk=chunk,
        parts=[head, *packed, bytes(indexes)],
        crc=crc32(indexes, crc32_combine(crc32(head), packed_crc, packed_size)),
        size=len(head) + packed_size + len(indexes),
        length=len(head) + packed_size,
        compression=compression,
        packed_size=packed_size,
        offsets=offsets,
    )


_own = threading.local()


def _compressor(*, is_big: bool) -> zstandard.ZstdCompressor:
    """Return this thread's own: to make one takes longer than to look at a sample."""
    name = "fast" if is_big else "usual"
    if not hasattr(_own, name):
        setattr(_own, name, zstandard.ZstdCompressor(_FAST if is_big else 3))
    compressor: zstandard.ZstdCompressor = getattr(_own, name)
    return compressor


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
