"""The chunk of an MCAP file that is still being filled."""

from struct import Struct
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

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
