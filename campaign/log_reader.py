"""The judges' reader of recordings: by the packages `mcap` and `msgpack` alone, no code of ours."""

from __future__ import annotations

import hashlib
import io
import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import msgpack
import yaml
import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata
from mcap.stream_reader import StreamReader

CHAIN = "stepbus/chain"
CALLS = "stepbus/calls"
DAMAGE = (
    EOFError,
    KeyError,
    McapError,
    MemoryError,
    OverflowError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)
"""What reading a damaged file may end in."""


class Row(NamedTuple):
    """A recorded message; t_ns: its time [ns]."""

    topic: str
    step: int
    t_ns: int
    content: bytes


@dataclass
class Log:
    """What a recording holds, as far as it can be read.

    rows: its messages, in file order. channels: topic → channel. metadata, attachments: name →
    content. damage: what ended the reading; empty where the file is whole.
    """

    rows: list[Row] = field(default_factory=list)
    channels: dict[str, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    damage: str = ""
    sha256: str = ""

    @property
    def last_step(self) -> int:
        """Return the newest step of any topic; −1 where there is none."""
        return max((row.step for row in self.rows), default=-1)

    def last_step_of(self, participant: str) -> int:
        """Return the newest step that a participant published itself; −1 where there is none."""
        # From `first` on, the orchestrator published on its behalf.
        held = self.metadata.get("on_fault", {})
        first = int(held["first"]) if held.get("participant") == participant else inf
        own = (row.step for row in self.rows if row.topic.partition("/")[0] == participant)
        return max((step for step in own if step < first), default=-1)

    def breaks(self) -> Iterator[tuple[str, int]]:
        """Yield (participant, step) where a record of a hash chain differs from the messages."""
        chains = _Chains(_every(self.attachments.get("scenario.yaml", b"")))
        for row in self.rows:
            if row.topic == CHAIN:
                yield from chains.check(row)
            elif row.topic != CALLS:
                chains.add(self.channels[row.topic], row)

    def holes(self) -> list[str]:
        """Return a sentence for each hash chain that breaks."""
        return [f"{name}: the hash chain breaks at or before step {n}" for name, n in self.breaks()]


def read(path: Path) -> Log:
    """Return what a recording holds; an empty log where there is no such file."""
    return parse(path.read_bytes()) if path.is_file() else Log()


def parse(data: bytes) -> Log:
    """Return what the bytes of a recording hold."""
    log, channels = Log(sha256=hashlib.sha256(data).hexdigest()), dict[int, Channel]()
    reader = StreamReader(io.BytesIO(data), validate_crcs=True, record_size_limit=None)
    try:
        for record in reader.records:
            if isinstance(record, Channel):
                channels[record.id] = log.channels[record.topic] = record
            elif isinstance(record, Attachment):
                log.attachments[record.name] = record.data
            elif isinstance(record, Metadata):
                log.metadata[record.name] = record.metadata
            elif isinstance(record, Message):
                topic = channels[record.channel_id].topic
                log.rows.append(Row(topic, record.sequence, record.log_time, record.data))
    except DAMAGE as exc:
        log.damage = repr(exc)
    return log


def _every(scenario: bytes) -> dict[str, int]:
    """Return participant → its `every`, from the recorded scenario."""
    try:
        rows = yaml.safe_load(scenario)["participants"]
        return {name: row.get("every", 1) for name, row in rows.items()}
    except (AttributeError, KeyError, TypeError, UnicodeDecodeError, yaml.YAMLError):
        return {}  # damaged


class _Chains:
    """The hash chain of every participant, computed anew from the messages (docs/protocol.md).

    every: participant → how many steps it fires apart.
    """

    def __init__(self, every: Mapping[str, int]) -> None:
        self._every = every
        self._values: dict[str, bytes] = {}
        self._next: dict[str, int] = {}
        self._pending: dict[str, dict[int, list[tuple[str, bytes]]]] = {}

    def add(self, channel: Channel, row: Row) -> None:
        """Keep a message for the next record of the chain."""
        steps = self._pending.setdefault(channel.metadata["participant"], {})
        steps.setdefault(row.step, []).append((channel.metadata["port"], row.content))

    def check(self, row: Row) -> list[tuple[str, int]]:
        """Return whose chain differs from what a record says, with the record's step."""
        record: dict[str, Any] = msgpack.unpackb(row.content)
        return [
            (name, record["step"])
            for name, expected in record["hashes"].items()
            if not self._reaches(name, record["step"], expected)
        ]

    def _reaches(self, name: str, last: int, expected: str) -> bool:
        """Extend one chain; it may end before `last`, in a run that failed."""
        value = self._values.get(name, bytes(32))
        pending = self._pending.pop(name, {})
        # A participant that has ended publishes nothing more: its chain stays what it was.
        reached = value.hex() == expected and not pending
        every = self._every.get(name, 1)
        for step in () if reached else range(self._next.get(name, 0), last + 1, every):
            digest = hashlib.sha256(value + step.to_bytes(8, "little", signed=True))
            for port, data in pending.pop(step, []):
                digest.update(port.encode() + data)
            value = digest.digest()
            self._next[name] = step + every
            reached = value.hex() == expected and not pending
            if reached:
                break
        self._values[name] = bytes.fromhex(expected)
        return reached


def result(folder: Path) -> dict[str, Any] | None:
    """Return result.json; None where there is none, or none that is complete."""
    try:
        content: dict[str, Any] = json.loads((folder / "result.json").read_text())
    except (OSError, ValueError):
        return None
    return content
