"""The chunk of an MCAP file: records of whole steps, compressed, and where in it they are."""

from struct import Struct

import zstandard
from isal.isal_zlib import crc32
from mcap import records as mcap
from mcap.opcode import Opcode

from stepbus_orchestrator.recording.records import bytes_of

BIG_BYTES = 64 * 1024
"""A larger message is content of a bulk port: a picture, a point cloud."""
_USUAL, _FAST = 3, -1
"""Levels of compression; that of large messages gives up soon where nothing is to be gained."""
_WORTH_IT = 0.9
"""What is not compressed to so much of its size is stored as it is: readers are spared the work."""
_INDEX = Struct("<BQHI")  # opcode, length, channel, length of the entries


class Chunk:
    """The chunk that is being filled; the builder of mcap calls four functions for each message.

    records: what it holds, in order. indexes: channel → log time and offset of each of its
    messages, one behind the other. is_big: whether it has a message of more than `BIG_BYTES`.
    """

    def __init__(self) -> None:
        self.records = bytearray()
        self.indexes: dict[int, list[int]] = {}
        self.is_big = False


def encode_chunk(chunk: Chunk, start: int) -> tuple[bytes, mcap.ChunkIndex]:
    """Return the bytes of a chunk with its message indexes, and its record of the summary.

    start: where it begins in the file [bytes]. Raises MemoryError.
    """
    content = bytes(chunk.records)
    packed, compression = _compressed(content, _FAST if chunk.is_big else _USUAL), "zstd"
    if chunk.is_big and len(packed) > _WORTH_IT * len(content):
        packed, compression = content, ""
    times = [t_ns for entries in chunk.indexes.values() for t_ns in entries[::2]]
    earliest, latest = min(times), max(times)
    record = bytes_of(
        mcap.Chunk(compression, packed, latest, earliest, crc32(content), len(content))
    )
    indexes, offsets = bytearray(), {}
    for channel, entries in chunk.indexes.items():
        offsets[channel] = start + len(record) + len(indexes)
        numbers = Struct(f"<{len(entries)}Q").pack(*entries)
        indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, len(numbers) + 6, channel, len(numbers))
        indexes += numbers
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
