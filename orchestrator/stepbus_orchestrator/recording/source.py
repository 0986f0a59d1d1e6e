"""The messages of a recording, read from the file when they are asked for."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path

import msgspec
from mcap.opcode import Opcode

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.index import Block, Index, Scanner, read_summary
from stepbus_orchestrator.recording.locked_file import is_locked
from stepbus_orchestrator.recording.records import (
    HEAD,
    LATEST_NS,
    DamagedRecord,
    RecordFile,
    Row,
    chunk_content,
    messages,
)

_CACHE_BYTES = 8 * 1024 * 1024

watchers: list[Callable[[Path, float], None]] = []
"""Are told, while a recording is read from its start, its path and how far it is (0 to 1)."""


class Entry(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """One recorded message: its step, its simulation time [ns] and its bytes."""

    step: int
    t_ns: int
    data: bytes


class Source:
    """An open recording.

    damage: what is wrong with the file, as far as it was read. is_live: whether it is being
    written; then it has what stood there when it was opened. cut_step: the last step where it is
    incomplete and left out. scanner: that has read the file; None where its summary was enough.

    scans: whether the summary is not trusted. Raises RecordingFailed when the file cannot be read
    or is no MCAP file.
    """

    def __init__(self, path: Path, *, scans: bool = False) -> None:
        self._scans = scans
        self.scanner: Scanner | None = None
        self._file = RecordFile(path)
        self.is_live = is_locked(self._file.descriptor)
        self._loose = b""
        self.index = self._read_index()
        self.damage = self.index.damage
        self._blocks = self.index.blocks
        self._blocks_of: dict[frozenset[int], list[Block]] = {}
        # The blocks that were read last, by their offset: the ports of a recording share them.
        self._cache: dict[int, bytes] = {}
        self._cached_bytes = 0
        self.cut_step: int | None = None
        self._cut_incomplete_step()

    def close(self) -> None:
        """Close the file; nothing more can be read."""
        self._file.close()
        self._cache.clear()

    def _read_index(self) -> Index:
        """Read the index, and with it what a run that goes on may replace any moment."""
        while True:
            index = None if self._scans else read_summary(self._file)
            if index is None:
                self.scanner = Scanner(self._file)
                index = self.scanner.index
            start = index.loose_from if self.is_live else None
            if start is None:
                return index
            self._loose = self._file.read(start, self._file.size - start)
            # A chunk that has come in the meantime begins with another byte.
            if self._file.read(start, 1) == bytes((Opcode.MESSAGE,)):
                return index

    def rows(self, channels: frozenset[int] | None = None) -> Iterator[Row]:
        """Yield the messages of some channels, or all, in recorded order, up to the first damage.

        It holds one block at a time.
        """
        wanted = frozenset(self.index.channels) if channels is None else channels
        try:
            for block in self._blocks:
                if block.channels & wanted:
                    yield from self._in_block(block, wanted)
                    for watch in watchers:
                        watch(self._file.path, block.offset / self._file.size)
        except DamagedRecord as exc:
            self._end_before(block, exc)
        finally:
            # Also of a reader who has seen enough.
            for watch in watchers:
                watch(self._file.path, 1.0)

    def latest(self, channels: frozenset[int], t_ns: int = LATEST_NS) -> Entry | None:
        """Return the newest message of some channels at a time or before; None without any.

        It reads the one chunk that has it.
        """
        blocks = self._blocks_of.get(channels)
        if blocks is None:
            blocks = [block for block in self._blocks if block.channels & channels]
            self._blocks_of[channels] = blocks
        for number in range(bisect_right(blocks, t_ns, key=attrgetter("start_ns")), 0, -1):
            block = blocks[number - 1]
            try:
                earlier = [row for row in self._in_block(block, channels) if row[2] <= t_ns]
            except DamagedRecord as exc:
                self._end_before(block, exc)
                continue
            if earlier:
                return Entry(step=earlier[-1][1], t_ns=earlier[-1][2], data=earlier[-1][3])
        return None

    def _cut_incomplete_step(self) -> None:
        """Leave out the last step where something of it may be missing, and say so.

        Its chain, which is written last, shows that nothing is.
        """
        while self._blocks and not self.index.ends_a_step:
            last = self._blocks[-1]
            try:
                *_, (channel, step, _, _) = self._in_block(last, last.channels)
            except DamagedRecord as exc:
                self._end_before(last, exc)
                continue
            if self.index.channels[channel].topic != layout.CHAIN_TOPIC:
                self.cut_step = step
                cut = layout.incomplete(step)
                self.damage = f"{self.damage}; {cut}" if self.damage else cut
            return

    def _end_before(self, block: Block, exc: DamagedRecord) -> None:
        """End the recording before a block that turned out to be damaged."""
        self.damage = str(exc)
        self._blocks = [other for other in self._blocks if other.offset < block.offset]
        self._blocks_of.clear()

    def _in_block(self, block: Block, channels: frozenset[int]) -> Iterator[Row]:
        data = self._cache.pop(block.offset, None)
        if data is None:
            data = self._read(block)
            self._cached_bytes += len(data)
        self._cache[block.offset] = data
        while self._cached_bytes > _CACHE_BYTES:
            self._cached_bytes -= len(self._cache.pop(next(iter(self._cache))))
        rows, end = messages(data, channels), self.cut_step
        return rows if end is None else (row for row in rows if row[1] < end)

    def _read(self, block: Block) -> bytes:
        """Return the records of a block; raises DamagedRecord."""
        start = block.offset - (self.index.loose_from or 0)
        if self._loose and start >= 0:
            return self._loose[start : start + block.length]
        opcode, content = self._file.record(block.offset)
        if len(content) != block.length - HEAD.size:
            raise DamagedRecord(
                f"the record at byte {block.offset} does not have the length given in the index"
            )
        if opcode == Opcode.CHUNK:
            return chunk_content(content)
        return HEAD.pack(opcode, len(content)) + content
