"""Reads what a sale recorded, with the packages `mcap` and `msgpack` alone."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgpack
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from campaign.log_reader import DAMAGE

Row = tuple[int, Mapping[str, Any]]


@dataclass
class SaleLog:
    """Topic → messages with their steps, in file order; topic → names of its description.

    bodies: link → the body of the world that it belongs to.
    """

    messages: dict[str, list[Row]] = field(default_factory=lambda: defaultdict(list))
    names: dict[str, list[str]] = field(default_factory=dict)
    bodies: dict[str, str] = field(default_factory=dict)
    is_whole: bool = True
    """Whether the recording could be read to its end."""

    def last(self, topic: str) -> Mapping[str, Any]:
        """Return the last message of a topic; empty: there is none."""
        rows = self.messages.get(topic)
        return rows[-1][1] if rows else {}

    def texts(self) -> Iterator[str]:
        """Yield every sentence of mission and controller."""
        for topic in ("mission/events", "mission/summary", "controller/goal_status"):
            yield from (row.get("text", "") for _, row in self.messages.get(topic, ()))
        for _, row in self.messages.get("controller/status", ()):
            yield from row.get("warnings", ())


_READ = (
    "plant/contacts", "plant/gripper", "plant/joint_state", "plant/odometry", "plant/poses",
    "controller/goal_status", "controller/status", "mission/events", "mission/summary",
)  # fmt: skip


def read(path: Path) -> SaleLog:
    """Return what a recording of the store holds, as far as it can be read."""
    log, channels = SaleLog(), dict[int, Channel]()
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, record_size_limit=None).records:
                _add(log, channels, record)
    except DAMAGE:
        log.is_whole = False
    return log


def _add(log: SaleLog, channels: dict[int, Channel], record: object) -> None:
    if isinstance(record, Channel):
        channels[record.id] = record
        about = json.loads(record.metadata.get("description", "{}"))
        log.names[record.topic] = about.get("names", [])
        if record.topic == "plant/poses":
            log.bodies = dict(zip(about["names"], about["details"]["body"], strict=True))
    elif isinstance(record, Message) and channels[record.channel_id].topic in _READ:
        topic = channels[record.channel_id].topic
        log.messages[topic].append((record.sequence, msgpack.unpackb(record.data)))
