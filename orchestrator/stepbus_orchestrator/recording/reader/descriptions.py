"""What a recording says of its ports before their first message: types, descriptions, names."""

import contextlib
import json
from collections.abc import Mapping, Sequence

import msgspec
from mcap.records import Channel

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.index import Index
from stepbus_orchestrator.scenario.ports import RECORD_ALL
from stepbus_schemas import (
    ENVELOPE_TYPES,
    MESSAGE_TYPES,
    Description,
    Types,
    WiringError,
    declaration_of,
)

_NO_SCHEMA = (ValueError, LookupError, TypeError, AttributeError, RecursionError)
_LOWEST = "lower"


def recorded_types(schemas: Mapping[str, bytes]) -> Types:
    """Return the types of a recording's schemas, by their names in the file.

    One that says no type stays unknown: reading its messages says so.
    """
    types = Types()
    for name, text in schemas.items():
        type_name = layout.type_of_schema(name)
        if type_name in MESSAGE_TYPES or type_name in ENVELOPE_TYPES:
            continue
        with contextlib.suppress(WiringError, *_NO_SCHEMA):
            types |= Types({type_name: declaration_of(type_name, json.loads(text))})
    return types


def description_of(channel: Channel) -> Description:
    """Return the description in a channel's metadata; raises ValueError when it is none."""
    content = json.loads(channel.metadata.get(layout.DESCRIPTION_KEY, "{}"))
    limits = content.get("limits") if isinstance(content, dict) else None
    if isinstance(limits, dict):
        # JSON can only write infinity as null: one in `lower` is −∞, elsewhere +∞.
        for key, row in limits.items():
            if isinstance(row, list):
                absent = float("-inf") if key == _LOWEST else float("inf")
                limits[key] = [absent if item is None else item for item in row]
    return msgspec.convert(content, Description)


class PortInfo:
    """What a recording says of a port before its first message.

    topic: `participant/port`. type: `Name/major`. description: as its participant gave it.
    record: what the recording has of it: `all`, `every 10` (of ten steps of its participant the
    first), or `off`. descriptions: of all ports of the recording, by topic, this one included.
    """

    def __init__(
        self, index: Index, channel: Channel, descriptions: Mapping[str, Description]
    ) -> None:
        self.topic = channel.topic
        self.participant, self.name = layout.split_topic(channel.topic)
        self.type = layout.type_of_schema(index.schemas.get(channel.schema_id, ""))
        self.description = descriptions[channel.topic]
        self.record = channel.metadata.get(layout.RECORD_KEY, RECORD_ALL)
        self._index = index
        self._descriptions = descriptions

    @property
    def names(self) -> Sequence[str]:
        """Return the names that the vectors of the port belong to, in their order.

        Those of a port that is `like` an input are those of its source.
        """
        topic, seen = self.topic, set[str]()
        while topic in self._descriptions and topic not in seen:
            seen.add(topic)
            description = self._descriptions[topic]
            if description.names or description.like is None:
                return description.names
            topic = self._source_of(layout.split_topic(topic)[0], description.like)
        return []

    def _source_of(self, participant: str, name: str) -> str:
        try:
            given = self._index.scenario["participants"][participant]["inputs"][name]
            source = given["from"] if isinstance(given, dict) else given
            return layout.topic_of(*source.split(".", 1))
        except (KeyError, TypeError, AttributeError):
            return ""
