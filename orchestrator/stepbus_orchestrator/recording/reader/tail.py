"""A recording that is being written: what is new in it, again and again."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Schema

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.reader.descriptions import (
    Names,
    read_description,
    recorded_types,
)
from stepbus_orchestrator.recording.records import (
    HEAD,
    MAGIC,
    STEP_END,
    DamagedRecord,
    records_of,
)
from stepbus_participant import open_regular
from stepbus_schemas import Decoder, Description, MessageError, StepbusError, Types
from stepbus_schemas import Message as PortMessage

from .source import unreadable

_SKIP_BYTES = 32 * 1024 * 1024
"""Of what is already there, so much of the end is read, and the beginning."""
_FIRST_BYTES = 4 * 1024 * 1024
_UNFINISHED = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))


class TailPort:
    """A port of a recording that is being written; as far as a `Port` describes it."""

    def __init__(self, topic: str, type_name: str, description: Description, tail: Tail) -> None:
        self.topic = topic
        self.participant, self.name = layout.split_topic(topic)
        self.type = type_name
        self.description = description
        self._tail = tail

    @property
    def names(self) -> Sequence[str]:
        """Return the names that the vectors of the port belong to, in their order."""
        return self._tail.names_of(self.topic)


class Tail:
    """Follows a recording as it grows; `poll` takes what is new.

    ports: by topic, as they appear. attachments: the scenario and its files. t_ns: simulation time
    of the newest message [ns]. is_complete: whether the file is closed. The recorder writes the
    open chunk behind the file's end, and the whole chunk in its place later: both are the same
    messages, and each is taken once.

    Raises RecordingFailed when the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ports: dict[str, TailPort] = {}
        self.attachments: dict[str, bytes] = {}
        self.types: Types = recorded_types({})
        self.is_complete = False
        self._schemas: dict[int, str] = {}
        self._texts: dict[str, bytes] = {}
        self._topics: dict[int, str] = {}
        self._newest: dict[str, tuple[int, bytes]] = {}
        self._decoded: dict[str, tuple[int, PortMessage]] = {}
        self._kept: dict[str, list[tuple[int, bytes]]] = {}
        self._position = len(MAGIC)
        self._taken = 0
        self.t_ns = 0
        self._skips = True
        try:
            self._file = open_regular(path)
        except OSError as exc:
            raise RecordingFailed(unreadable(path, exc)) from exc

    def keep(self, topics: Iterable[str]) -> None:
        """Keep every message of some topics from now on, until `take_kept`."""
        for topic in topics:
            self._kept.setdefault(topic, [])

    def take_kept(self, topic: str) -> list[tuple[int, bytes]]:
        """Return (step, bytes) of the messages of a topic since the last time."""
        messages = self._kept.get(topic, [])
        if messages:
            self._kept[topic] = []
        return messages

    def poll(self) -> bool:
        """Take what is new; returns whether there was anything."""
        size = os.fstat(self._file).st_size
        before = (self._position, self._taken)
        while self._position < size and not self.is_complete and self._take_next(size):
            pass
        self._skips = False
        return before != (self._position, self._taken)

    def _take_next(self, size: int) -> bool:
        """Take the record behind the last whole one; returns whether it is whole too."""
        head = os.pread(self._file, HEAD.size, self._position)
        if len(head) < HEAD.size:
            return False
        opcode, length = HEAD.unpack(head)
        if opcode in _UNFINISHED:
            self._take_unfinished(size)
            return False
        end = self._position + HEAD.size + length
        if end > size:
            return False
        if opcode == Opcode.DATA_END:
            self.is_complete = True
        elif not self._is_skipped(opcode, end, size) and not self._take_record(opcode, length):
            return False
        self._position = end
        return True

    def _is_skipped(self, opcode: int, end: int, size: int) -> bool:
        """Return whether a chunk is old, of a recording that was long when it was first seen."""
        is_old = _FIRST_BYTES < end < size - _SKIP_BYTES
        return opcode == Opcode.CHUNK and self._skips and is_old

    def _take_record(self, opcode: int, length: int) -> bool:
        content = os.pread(self._file, length, self._position + HEAD.size)
        try:
            records = list(records_of(opcode, content, checked=True))
        except DamagedRecord:
            # It is just being written.
            return False
        messages = [record for record in records if isinstance(record, Message)]
        self._add_all(records, messages[self._taken :])
        if opcode == Opcode.CHUNK:
            self._taken = 0
        return True

    def _take_unfinished(self, size: int) -> None:
        """Take the messages of the open chunk that stand behind the file's end."""
        start = self._position
        data = os.pread(self._file, size - start, start)
        records = list(_whole_records(data))
        # The chunk may have come in their place in the meantime.
        if os.pread(self._file, HEAD.size, start) != data[: HEAD.size]:
            return
        messages = [record for record in records if isinstance(record, Message)]
        self._add_all(records, messages[self._taken :])
        self._taken = max(self._taken, len(messages))

    def _add_all(self, records: Iterable[object], messages: Iterable[Message]) -> None:
        for record in records:
            match record:
                case Schema():
                    self._schemas[record.id] = record.name
                    if record.name not in self._texts:
                        self._texts[record.name] = record.data
                        self.types = recorded_types(self._texts)
                case Channel() if record.id not in self._topics:
                    self._add_channel(record)
                case Attachment():
                    self.attachments[record.name] = record.data
        for message in messages:
            topic = self._topics.get(message.channel_id)
            if topic is not None:
                self._newest[topic] = (message.sequence, message.data)
                self.t_ns = max(self.t_ns, message.log_time)
                if topic in self._kept:
                    self._kept[topic].append((message.sequence, message.data))

    def _add_channel(self, record: Channel) -> None:
        self._topics[record.id] = record.topic
        type_name = layout.type_of_schema(self._schemas.get(record.schema_id, ""))
        try:
            text = record.metadata.get(layout.DESCRIPTION_KEY, "{}")
            description = read_description(text)
        except ValueError:
            description = Description()
        self.ports[record.topic] = TailPort(record.topic, type_name, description, self)

    def names_of(self, topic: str) -> Sequence[str]:
        """Return the names that the vectors of a port belong to."""
        descriptions = {name: port.description for name, port in self.ports.items()}
        return Names(descriptions, self.attachments).of(topic)

    @property
    def last_step(self) -> int:
        """Return the newest step with a message; −1 without any."""
        return max((step for step, _ in self._newest.values()), default=-1)

    def newest(self, topic: str) -> tuple[int, bytes] | None:
        """Return (step, bytes) of the newest message of a port; None before the first."""
        return self._newest.get(topic)

    @property
    def step_ns(self) -> int:
        """Return the length of a step [ns], as the recording has it; 0 before step 1."""
        return self.t_ns // self.last_step if self.last_step > 0 else 0

    def latest(self, topic: str) -> tuple[int, PortMessage] | None:
        """Return (step, message) of the newest message of a port; None without one to read."""
        if topic not in self._newest:
            return None
        step, data = self._newest[topic]
        known = self._decoded.get(topic)
        if known is None or known[0] != step:
            message = self.decode(topic, data)
            if message is None:
                return None
            known = self._decoded[topic] = (step, message)
        return known

    def decode(self, topic: str, data: bytes) -> PortMessage | None:
        """Return a message of a port; None for one that cannot be read."""
        try:
            return Decoder(self.types[self.ports[topic].type])(data)
        except (MessageError, StepbusError, KeyError):
            return None

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _whole_records(data: bytes) -> Iterator[object]:
    """Yield the records of a file's end, up to the first that is not whole."""
    offset = 0
    while len(data) - offset >= HEAD.size:
        opcode, length = HEAD.unpack_from(data, offset)
        start = offset + HEAD.size
        offset = start + length
        if opcode == STEP_END:
            continue
        if offset > len(data) or opcode not in _UNFINISHED:
            return
        try:
            yield from records_of(opcode, data[start:offset])
        except DamagedRecord:
            return
