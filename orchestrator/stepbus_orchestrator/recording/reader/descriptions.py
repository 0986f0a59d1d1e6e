"""The message types that a recording brings, from its schemas."""

import contextlib
import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import msgspec

from stepbus_orchestrator.recording import layout
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import (
    ENVELOPE_TYPES,
    MESSAGE_TYPES,
    Description,
    StepbusError,
    Types,
    WiringError,
    declaration_of,
)

_NO_SCHEMA = (ValueError, LookupError, TypeError, AttributeError, RecursionError)


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


_LOWEST = "lower"


def read_description(text: str) -> Description:
    """Return the description in a channel's metadata; raises ValueError when it is none."""
    return msgspec.convert(_with_infinities(json.loads(text)), Description)


def _with_infinities(value: object) -> object:
    """Return JSON with infinite limits, which JSON can only write as null, put back.

    A limit of null in `lower` is −∞, elsewhere +∞.
    """
    limits = value.get("limits") if isinstance(value, dict) else None
    if isinstance(limits, dict):
        for key, row in limits.items():
            if isinstance(row, list):
                absent = float("-inf") if key == _LOWEST else float("inf")
                limits[key] = [absent if item is None else item for item in row]
    return value


class Names:
    """The names of all ports, also where a port's description is `like` an input.

    descriptions: by topic. attachments: with the scenario, which says where inputs come from.
    """

    def __init__(
        self, descriptions: Mapping[str, Description], attachments: Mapping[str, bytes]
    ) -> None:
        self._descriptions = descriptions
        self._attachments = attachments

    def of(self, topic: str) -> Sequence[str]:
        """Return the names of a port; none where nobody gave any."""
        seen = set()
        while topic in self._descriptions and topic not in seen:
            seen.add(topic)
            description = self._descriptions[topic]
            if description.names or description.like is None:
                return description.names
            topic = self._source_of(layout.split_topic(topic)[0], description.like)
        return []

    def _source_of(self, participant: str, name: str) -> str:
        try:
            given = self._participants[participant]["inputs"][name]
            source = given["from"] if isinstance(given, dict) else given
            return layout.topic_of(*source.split(".", 1))
        except (KeyError, TypeError, AttributeError):
            return ""

    @cached_property
    def _participants(self) -> Mapping[str, Any]:
        text = self._attachments.get(layout.SCENARIO_ATTACHMENT, b"").decode(errors="replace")
        try:
            content = parse_yaml(layout.SCENARIO_ATTACHMENT, text)
        except StepbusError:
            return {}
        participants = content.get("participants") if isinstance(content, dict) else None
        return participants if isinstance(participants, dict) else {}
