"""The chunk of an MCAP file: records of whole steps, compressed, and where in it they are."""

import zlib
from struct import Struct
from typing import NamedTuple

import zstandard
from mcap import records as mcap
from mcap.opcode import Opcode

from stepbus_orchestrator.recording.checksum import crc32_of_both

BIG_BYTES = 64 * 1024
"""A larger message is content of a bulk port: a picture, a point cloud."""
_FAST = -1
"""The level of compression for these: it gives up soon where nothing is to be gained."""
_WORTH_IT = 0.9
"""What is not compressed to so much of its size is stored as it is: readers are spared the work."""

_CHUNK = Struct("<BQQQQI")  # opcode, length, two times, size and CRC of what it holds
_SIZE = Struct("<Q")
_TEXT = Struct("<I")
_INDEX = Struct("<BQHI")  # opcode, length, channel, length of the entries
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

    def compressor(self) -> zstandard.ZstdCompressor:
        """Return a new compressor of the level that it is written with."""
        return zstandard.ZstdCompressor(_FAST) if self.is_big else zstandard.ZstdCompressor()


class Encoded(NamedTuple):
    """A chunk as it stands in a file: its bytes, with the message indexes behind it.

    crc: of these, where the chunk is big. row: of the index, as if the file began with it.
    """

    chunk: Chunk
    data: bytes
    crc: int
    row: mcap.ChunkIndex

    def crc_behind(self, before: int) -> int:
        """Return the checksum of a file up to the end of it; before: up to its beginning."""
        if self.chunk.is_big:
            return crc32_of_both(before, self.crc, len(self.data))
        return zlib.crc32(self.data, before)


def encode_chunk(chunk: Chunk, compressor: zstandard.ZstdCompressor) -> Encoded:
    """Return the bytes of a chunk: a function of its messages alone. compressor: of its level."""
    content = chunk.content()
    crc = zlib.crc32(content)
    packed, compression = compressor.compress(content), "zstd"
    if chunk.is_big and len(packed) > _WORTH_IT * len(content):
        packed, compression = content, ""
    name = _TEXT.pack(len(compression)) + compression.encode()
    length = _CHUNK.size - _HEAD_BYTES + len(name) + _SIZE.size + len(packed)
    head = _CHUNK.pack(Opcode.CHUNK, length, chunk.earliest, chunk.latest, len(content), crc)
    head += name + _SIZE.pack(len(packed))
    indexes, offsets = bytearray(), {}
    for channel, entries in chunk.indexes.items():
        offsets[channel] = len(head) + len(packed) + len(indexes)
        numbers = Struct(f"<{len(entries)}Q").pack(*entries)
        indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, len(numbers) + 6, channel, len(numbers))
        indexes += numbers
    whole_crc = 0
    if chunk.is_big:
        # The checksum of what is stored as it is has been computed already.
        packed_crc = zlib.crc32(packed) if compression else crc
        whole_crc = crc32_of_both(zlib.crc32(head), packed_crc, len(packed))
        whole_crc = zlib.crc32(indexes, whole_crc)
    row = mcap.ChunkIndex(
        chunk_length=len(head) + len(packed),
        chunk_start_offset=0,
        compression=compression,
        compressed_size=len(packed),
        message_end_time=chunk.latest,
        message_index_length=len(indexes),
        message_index_offsets=offsets,
        message_start_time=chunk.earliest,
        uncompressed_size=len(content),
    )
    return Encoded(
        chunk=chunk,
        data=b"".join((head, packed, indexes)),
        crc=whole_crc,
        row=row,
    )
