"""Reads `run.mcap` with the packages `mcap` and `msgpack` alone, and finds what is missing."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

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


@dataclass
class Log:
    """What a recording holds.

    steps: topic → sequence numbers in file order. holes: sentences. held: participant → the first
    step that the orchestrator published on its behalf.
    """

    steps: dict[str, list[int]] = field(default_factory=dict)
    holes: list[str] = field(default_factory=list)
    held: dict[str, int] = field(default_factory=dict)
    sha256: str = ""

    @property
    def last_step(self) -> int:
        """Return the newest step of any topic; −1 where there is none."""
        return max((steps[-1] for steps in self.steps.values() if steps), default=-1)

    def last_step_of(self, participant: str) -> int:
        """Return the newest step that a participant published itself; −1 where there is none."""
        topics = (t for t in self.steps if t.split("/")[0] == participant)
        steps = (step for topic in topics for step in self.steps[topic])
        first = self.held.get(participant, inf)
        return max((step for step in steps if step < first), default=-1)


def read(path: Path) -> Log:
    """Return what a recording holds, as far as it can be read."""
    log = Log()
    if not path.is_file():
        return log
    log.sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    chains = _Chains({})
    for record, channel in _records(path):
        if isinstance(record, Attachment) and record.name == "scenario.yaml":
            chains = _Chains(_every(record.data))
        elif isinstance(record, Metadata) and record.name == "on_fault":
            log.held[record.metadata["participant"]] = int(record.metadata["first"])
        elif channel is not None and isinstance(record, Message):
            log.steps.setdefault(channel.topic, []).append(record.sequence)
            if channel.topic == CHAIN:
                log.holes += chains.check(record)
            elif channel.topic != CALLS:
                chains.add(channel, record)
    return log


def _records(path: Path) -> Iterator[tuple[object, Channel | None]]:
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        try:
            for record in StreamReader(file, record_size_limit=None).records:
                if isinstance(record, Channel):
                    channels[record.id] = record
                yield record, channels[record.channel_id] if isinstance(record, Message) else None
        except DAMAGE:
            return


def _every(scenario: bytes) -> dict[str, int]:
    """Return participant → its `every`, from the recorded scenario."""
    try:
        rows = yaml.safe_load(scenario)["participants"]
        return {name: row.get("every", 1) for name, row in rows.items()}
    except (AttributeError, KeyError, TypeError, UnicodeDecodeError, yaml.YAMLError):
        return {}  # damaged


class _Chains:
    """The hash chain of every participant, computed anew from the messages (docs/protocol.md)."""

    def __init__(self, every: dict[str, int]) -> None:
        self._every = every
        self._values: dict[str, bytes] = {}
        self._next: dict[str, int] = {}
        self._pending: dict[str, dict[int, list[tuple[str, bytes]]]] = {}

    def add(self, channel: Channel, message: Message) -> None:
        """Keep a message for the next record of the chain."""
        steps = self._pending.setdefault(channel.metadata["participant"], {})
        steps.setdefault(message.sequence, []).append((channel.metadata["port"], message.data))

    def check(self, message: Message) -> list[str]:
        """Return whose chain differs from what a record says."""
        record: dict[str, Any] = msgpack.unpackb(message.data)
        return [
            f"{name}: the hash chain breaks at or before step {record['step']}"
            for name, expected in record["hashes"].items()
            if not self._reaches(name, record["step"], expected)
        ]

    def _reaches(self, name: str, last: int, expected: str) -> bool:
        """Extend one chain; it may end before `last`, in a run that failed."""
        value = self._values.get(name, bytes(32))
        pending = self._pending.pop(name, {})
        # A participant that has ended publishes nothing more: its chain stays what it was.
        reached = value.hex() == expected and not pending
        for step in (
            () if reached else range(self._next.get(name, 0), last + 1, self._every.get(name, 1))
        ):
            digest = hashlib.sha256(value + step.to_bytes(8, "little", signed=True))
            for port, data in pending.pop(step, []):
                digest.update(port.encode() + data)
            value = digest.digest()
            self._next[name] = step + self._every.get(name, 1)
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
