"""What a sale recorded, decoded."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgpack

from campaign.log_reader import Log

Row = tuple[int, Mapping[str, Any]]


@dataclass
class SaleLog:
    """Topic → messages with their steps, in file order; topic → names of its description.

    bodies: link → the body of the world that it belongs to. is_whole: whether the recording could
    be read to its end.
    """

    messages: dict[str, list[Row]] = field(default_factory=lambda: defaultdict(list))
    names: dict[str, list[str]] = field(default_factory=dict)
    bodies: dict[str, str] = field(default_factory=dict)
    is_whole: bool = True

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


def decoded(log: Log) -> SaleLog:
    """Return what a recording of the store holds."""
    sale = SaleLog(is_whole=not log.damage)
    for topic, channel in log.channels.items():
        about = json.loads(channel.metadata.get("description", "{}"))
        sale.names[topic] = about.get("names", [])
        if topic == "plant/poses":
            sale.bodies = dict(zip(about["names"], about["details"]["body"], strict=True))
    for row in log.rows:
        if row.topic in _READ:
            sale.messages[row.topic].append((row.step, msgpack.unpackb(row.content)))
    return sale
