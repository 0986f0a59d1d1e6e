"""Judges what the readers of a recording answered, by what is in its bytes."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import breakup_chunk

from ..log_reader import CHAIN
from ..log_reader import DAMAGE as UNREADABLE
from .mutations import DAMAGE, FORGED, HEAD, Mutation, records, rewritten
from .readers import Answer

Row = tuple[str, int, bytes]


def messages(data: bytes) -> list[Row]:
    """Return (topic, step, content) of the messages up to the first damage, without the chain.

    Damage of what holds no messages ends nothing.
    """
    intact: list[Row] = []
    channels: dict[int, str] = {}
    try:
        for record in _records(data):
            if isinstance(record, Channel):
                channels.setdefault(record.id, record.topic)
            elif isinstance(record, Message) and channels[record.channel_id] != CHAIN:
                intact.append((channels[record.channel_id], record.sequence, record.data))
    except UNREADABLE:
        pass
    return intact


def indexed(data: bytes) -> list[Row]:
    """Return the same of the messages that its index leads to, where all chunks are whole.

    Damage between the chunks hides nothing from a reader that goes by the index.
    """
    try:
        indexed = make_reader(io.BytesIO(data), validate_crcs=True).iter_messages(
            log_time_order=False
        )
        return [(c.topic, m.sequence, m.data) for _, c, m in indexed if c.topic != CHAIN]
    except UNREADABLE:
        return []


def _records(data: bytes) -> Iterator[object]:
    for opcode, start, end in records(data):
        if opcode == Opcode.DATA_END or end > len(data):
            return
        content = data[start + HEAD.size : end]
        stream = ReadDataStream(io.BytesIO(content))
        if opcode == Opcode.CHUNK:
            yield from breakup_chunk(Chunk.read(stream), validate_crc=True)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif opcode == Opcode.MESSAGE:
            yield Message.read(stream, len(content))


class Judge:
    """Judges the answers about one mutated recording.

    original, data: bytes before and after the mutation.
    """

    def __init__(self, mutation: Mutation, original: bytes, data: bytes) -> None:
        self._is_changed = original != data
        before, after = messages(original), messages(data)
        self._is_damaged = self._is_changed and mutation in DAMAGE
        self._is_whole = mutation is rewritten
        self._is_forged = mutation in FORGED and _by_port(before) != _by_port(after)
        # What a damaged file has twice was left by an earlier write.
        kept = list(dict.fromkeys(after)) if self._is_damaged else after
        self._differs = _by_port(before) not in (_by_port(kept), _by_port(indexed(data)))

    def judge(self, reader: str, answer: Answer) -> Iterator[str]:
        """Yield what is wrong with an answer."""
        said = answer.text
        if "Traceback" in said or "Exception ignored" in said:
            yield f"{reader}: traceback: {said.strip()[-200:]!r}"
        if answer.code < 0 or answer.code == 1:
            yield f"{reader}: exit code {answer.code}: {said.strip()[-200:]!r}"
        if reader.startswith("recover") and self._is_whole and ": undamaged" not in said:
            yield f"{reader}: wrong damage: {said[:200]!r}"
        if reader.startswith("recover") and ": undamaged" in said:
            if self._is_damaged:
                yield f"{reader}: wrong undamaged"
            if self._is_forged:
                yield f"{reader}: wrong undamaged, though the hash chain breaks"
        if reader.startswith("diff") and answer.code == 0 and self._differs:
            yield f"{reader}: wrong equal: {said[:100]!r}"


def _by_port(rows: list[Row]) -> Mapping[str, list[tuple[int, bytes]]]:
    by_port: dict[str, list[tuple[int, bytes]]] = {}
    for topic, step, content in rows:
        by_port.setdefault(topic, []).append((step, content))
    return by_port
