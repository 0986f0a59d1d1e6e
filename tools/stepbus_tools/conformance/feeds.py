"""What the sources of a participant publish, and other forms of the same."""

import os
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec
from msgspec import structs

from stepbus_orchestrator.processes.slots import slot_counts
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import SlotError, SlotWriter, file_name, make_file, read_slot
from stepbus_schemas import SHIPPED, Description, Outputs, Ready, Types, encode, json_schema

Ports = Mapping[str, bytes]
"""Output port → encoded message."""

Feed = Mapping[str, Mapping[int, Ports]]
"""Source → step → what it publishes."""

Edit = Callable[[str, str, bytes], bytes]
"""Returns another message for (source, port, message)."""


def edited(feed: Feed, edit: Edit) -> Feed:
    """Return a feed with every message replaced by `edit`."""
    return each_step(
        feed,
        lambda source, _, row: {port: edit(source, port, data) for port, data in row.items()},
    )


def each_step(feed: Feed, change: Callable[[str, int, Ports], Ports]) -> Feed:
    """Return a feed with other outputs: `change` gets source, step and outputs."""
    return {
        source: {step: change(source, step, row) for step, row in rows.items()}
        for source, rows in feed.items()
    }


def thinned(feed: Feed, every: Mapping[str, int]) -> Feed:
    """Return a feed in which sources publish at multiples of a step only, and nothing between."""
    return each_step(feed, lambda source, step, row: {} if step % every[source] else row)


def shifted(feed: Feed, ports: Collection[tuple[str, str]], delay: int) -> Feed:
    """Return a feed in which some ports, as (source, port), come `delay` steps later."""

    def change(source: str, step: int, row: Ports) -> Ports:
        earlier = feed[source].get(step - delay, {})
        own = {port: data for port, data in row.items() if (source, port) not in ports}
        return own | {port: data for port, data in earlier.items() if (source, port) in ports}

    return each_step(feed, change)


def repeated(feed: Feed) -> Feed:
    """Return a feed in which a step without a port has the message of the step before."""
    held: dict[str, dict[str, bytes]] = {source: {} for source in feed}

    def change(source: str, _: int, row: Ports) -> Ports:
        held[source] = {**held[source], **row}
        return held[source]

    return each_step(feed, change)


# --- messages and their vectors --------------------------------------------------------------


def vectors_of(type_name: str, types: Types = SHIPPED) -> set[str]:
    """Return the fields of a message type that have one value for each name."""
    fields = json_schema(type_name, types)["properties"]
    return {name for name, field in fields.items() if field.get("shape") == ["n"]}


def plain(type_name: str, data: bytes, types: Types = SHIPPED) -> dict[str, Any]:
    """Return a message as a map of plain values."""
    message = msgspec.msgpack.decode(data, type=types[type_name])
    fields: dict[str, Any] = msgspec.to_builtins(message)
    return fields


def reverse(type_name: str, data: bytes, types: Types = SHIPPED) -> bytes:
    """Return a message with each of its vectors in reversed order."""
    vectors = vectors_of(type_name, types)
    fields = plain(type_name, data, types)
    turned = {k: v[::-1] if k in vectors and v else v for k, v in fields.items()}
    return encode(msgspec.convert(turned, types[type_name]))


def reverse_description(description: Description) -> Description:
    """Return a description with its names, and all rows that belong to them, reversed."""
    return msgspec.structs.replace(
        description,
        names=description.names[::-1],
        limits={key: row[::-1] for key, row in description.limits.items()},
        details={key: row[::-1] for key, row in description.details.items()},
    )


class SharedSlots:
    """A file for each bulk output of one participant and of those that it reads.

    agreed: output → number of its slots, once the participant has named those that it can use.
    """

    def __init__(self, folder: Path, scenario: Scenario, spec: ParticipantSpec) -> None:
        self.folder = folder
        self.agreed: dict[str, int] = {}
        self._name = spec.name
        own = {file_name(spec.name, port) for port in spec.outputs}
        read = {file_name(item.source, item.port) for item in spec.inputs.values()}
        # It publishes what its peers have recorded, and waits for no answer.
        counts = slot_counts(scenario, has_feedback=False)
        self._counts = {n: c for n, c in counts.items() if n in own | read}
        folder.mkdir(0o700)
        self._files = {name: make_file(folder / name, 0o600) for name in self._counts}
        self._writers: dict[str, SlotWriter] = {}

    def agree(self, ready: Ready) -> Mapping[str, int]:
        """Return what the `Start` says of slots."""
        self.agreed = {n: count for n, count in self._counts.items() if n in ready.slots}
        for name, count in self.agreed.items():
            self._writers[name] = SlotWriter(self._files[name], count, self.folder / name)
        return self.agreed

    def write(
        self, source: str, outputs: Outputs, content: dict[str, bytes], late: int = 0
    ) -> tuple[Outputs, dict[str, bytes]]:
        """Write content of a peer into slots; return its outputs, and what travels in messages.

        late: by how many steps the stamps are wrong.
        """
        names = {port: file_name(source, port) for port in content}
        slots = {
            port: self._writers[name].write(outputs.step - late, content[port])
            for port, name in names.items()
            if name in self.agreed
        }
        rest = {port: data for port, data in content.items() if port not in slots}
        return structs.replace(outputs, slots=slots), rest

    def read(self, port: str, outputs: Outputs) -> bytes:
        """Return what the participant has written; raises SlotError."""
        name, length = file_name(self._name, port), outputs.bulk.get(port)
        if name not in self.agreed or length is None:
            raise SlotError("it is in a slot, but no slots were agreed on")
        return read_slot(self._files[name], outputs.slots[port], outputs.step, length)

    def close(self) -> None:
        """Close the files; harmless when repeated."""
        while self._files:
            os.close(self._files.popitem()[1])
