"""A recording that is being written: what is new in it, again and again."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mcap import records as mcap
from mcap.opcode import Opcode

from stepbus_orchestrator.recording.index import Index
from stepbus_orchestrator.recording.reader.port import PortInfo, description_of, recorded_types
from stepbus_orchestrator.recording.records import (
    HEAD,
    LOOSE,
    MAGIC,
    DamagedRecord,
    RecordFile,
    chunk_content,
    messages,
    parsed,
    read_head,
)
from stepbus_schemas import Decoder, Description, Message, MessageError, StepbusError, Types

_SKIP_BYTES = 32 * 1024 * 1024
"""Of what is already there, so much of the end is read, and the beginning."""
_FIRST_BYTES = 4 * 1024 * 1024


class Tail:
    """Follows a recording as it grows; `poll` takes what is new.

    ports: by topic, as they appear. attachments: the scenario and its files. t_ns: simulation time
    of the newest message [ns]. is_complete: whether the file is closed. The recorder writes the
    open chunk after the file's end, and the whole chunk in its place later: both are the same
    messages, and each is taken once.

    Raises RecordingFailed when the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ports: dict[str, PortInfo] = {}
        self.types: Types = recorded_types(())
        self.is_complete = False
        self.t_ns = 0
        self._file = RecordFile(path)
        self.close = self._file.close
        self._index = Index(path=path)
        self.attachments = self._index.attachments
        self._descriptions: dict[str, Description] = {}
        self._newest: dict[str, tuple[int, bytes]] = {}
        self._kept: dict[str, list[tuple[int, bytes]]] = {}
        self._position = len(MAGIC)
        self._taken = 0
        """How many messages of the chunk at the position have been taken already."""
        self._skips = True

    @property
    def scenario(self) -> Mapping[str, Any]:
        """Return what the scenario says; empty where it cannot be read."""
        return self._index.scenario

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
        before, size = (self._position, self._taken), self._file.size
        # What is not whole is just being written.
        with contextlib.suppress(DamagedRecord):
            while not self.is_complete and self._take_next(size):
                pass
        self._skips = False
        return before != (self._position, self._taken)

    def _take_next(self, size: int) -> bool:
        """Take the record after the last whole one; return whether another may follow.

        Raises DamagedRecord when it is not whole.
        """
        start = self._position
        head = self._file.read(start, HEAD.size)
        opcode, length = read_head(head, start, size)
        end = start + HEAD.size + length
        if opcode in LOOSE:
            loose = self._file.read(start, size - start)
            # The chunk may have come in their place in the meantime.
            if self._file.read(start, HEAD.size) == head:
                self._take(loose)
            return False
        content = self._file.read(start + HEAD.size, length)
        if opcode != Opcode.CHUNK:
            self._describe(parsed(opcode, content))
        elif not (self._skips and _FIRST_BYTES < end < size - _SKIP_BYTES):
            self._take(chunk_content(content))
        self.is_complete = opcode == Opcode.DATA_END
        self._position = end
        if opcode == Opcode.CHUNK:
            self._taken = 0
        return True

    def _take(self, records: bytes) -> None:
        """Take the messages among records that are new."""
        rows = messages(records, describe=self._describe)
        for number, (channel, step, t_ns, data) in enumerate(rows, 1):
            if number > self._taken and channel in self._index.channels:
                self._taken = number
                topic = self._index.channels[channel].topic
                self._newest[topic] = (step, data)
                self.t_ns = max(self.t_ns, t_ns)
                if topic in self._kept:
                    self._kept[topic].append((step, data))

    def _describe(self, record: Any) -> None:
        is_known = isinstance(record, mcap.Channel) and record.id in self._index.channels
        self._index.add(record)
        if isinstance(record, mcap.Schema):
            self.types = recorded_types(self._index.schemas.values())
        elif isinstance(record, mcap.Channel) and not is_known:
            self._descriptions[record.topic] = Description()
            with contextlib.suppress(ValueError):
                self._descriptions[record.topic] = description_of(record)
            self.ports[record.topic] = PortInfo(self._index, record, self._descriptions)

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

    def latest(self, topic: str) -> tuple[int, Message] | None:
        """Return (step, message) of the newest message of a port; None without one to read."""
        step, data = self._newest.get(topic, (-1, b""))
        message = None if step < 0 else self.decode(topic, data)
        return None if message is None else (step, message)

    def decode(self, topic: str, data: bytes) -> Message | None:
        """Return a message of a port; None for one that cannot be read."""
        try:
            return Decoder(self.types[self.ports[topic].type])(data)
        except (MessageError, StepbusError, KeyError):
            return None
