"""Reads a recording: channels, messages, attachments; also one that was cut off anywhere."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from mcap.records import Attachment, Channel, Message, Metadata, Schema

from stepbus_schemas import Decoder, Description, WiringError, message_class
from stepbus_schemas import Message as PortMessage

from .scanner import Salvage

_PREFIX = "stepbus."


@dataclass(frozen=True, kw_only=True)
class Port:
    """One recorded port.

    topic: `participant/port`. type: `Name/major`. description: what its participant said of it.
    """

    topic: str
    participant: str
    name: str
    type: str
    description: Description


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One recorded message: its step, its simulation time [ns] and its bytes."""

    step: int
    t_ns: int
    data: bytes


@dataclass(kw_only=True)
class Recording:
    """A recording in memory.

    ports: by topic, in recorded order. entries: by topic, in the order of their steps.
    attachments: by name. metadata: by name. damage: what is wrong with the file, empty when
    nothing is; all that stands before the damage is here.
    """

    path: Path
    ports: dict[str, Port] = field(default_factory=dict)
    entries: dict[str, list[Entry]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    damage: str = ""

    @classmethod
    def open(cls, path: Path) -> Recording:
        """Read a recording.

        Raises RecordingFailed when the file cannot be read or is no MCAP file.
        """
        recording = cls(path=path)
        salvage = Salvage(path)
        schemas: dict[int, str] = {}
        channels: dict[int, list[Entry]] = {}
        for record in salvage.records():
            if isinstance(record, Message):
                entry = Entry(step=record.sequence, t_ns=record.log_time, data=record.data)
                channels[record.channel_id].append(entry)
            elif isinstance(record, Schema):
                schemas[record.id] = record.name.removeprefix(_PREFIX)
            elif isinstance(record, Channel):
                channels[record.id] = recording._add(record, schemas.get(record.schema_id, ""))
            elif isinstance(record, Attachment):
                recording.attachments[record.name] = record.data
            elif isinstance(record, Metadata):
                recording.metadata[record.name] = record.metadata
        recording.damage = salvage.damage
        return recording

    def _add(self, channel: Channel, type_name: str) -> list[Entry]:
        """Note a channel; return where its messages go."""
        participant, _, name = channel.topic.partition("/")
        text = channel.metadata.get("description", "{}")
        if channel.topic not in self.ports:
            self.ports[channel.topic] = Port(
                topic=channel.topic,
                participant=participant,
                name=name,
                type=type_name,
                description=_description(text),
            )
        return self.entries.setdefault(channel.topic, [])

    def of_type(self, type_name: str) -> list[Port]:
        """Return the ports of a message type, e.g. `JointState/1`, in recorded order."""
        return [port for port in self.ports.values() if port.type == type_name]

    def messages(self, topic: str) -> Iterator[tuple[int, PortMessage]]:
        """Yield (step, message) of a port.

        Raises WiringError when this version does not know its type, MessageError for a message
        that is not of it.
        """
        decode = Decoder(message_class(self.ports[topic].type))
        for entry in self.entries[topic]:
            yield entry.step, decode(entry.data)


def _description(text: str) -> Description:
    try:
        return msgspec.convert(_without_null(json.loads(text)), Description)
    except (ValueError, msgspec.ValidationError) as exc:
        raise WiringError(f"a channel's description is not one: {exc}") from exc


def _without_null(value: object) -> object:
    """Return JSON with infinite limits, which JSON can only write as null, put back.

    A limit of null in `lower` is −∞, elsewhere +∞.
    """
    if isinstance(value, dict):
        limits = value.get("limits", {})
        for key, row in limits.items():
            empty = float("-inf") if key == "lower" else float("inf")
            limits[key] = [empty if item is None else item for item in row]
    return value
