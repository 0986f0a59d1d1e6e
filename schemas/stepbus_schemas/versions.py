"""Which protocol numbers are spoken, and what was named differently in earlier ones (P14)."""

from collections.abc import Iterable, Mapping

import msgspec

from .protocol import PROTOCOL_VERSION, Hello


class Protocols(msgspec.Struct, frozen=True):
    """A range of protocol numbers, with both ends; empty where lowest > highest."""

    lowest: int
    highest: int

    def __str__(self) -> str:
        """Return `protocol 2`, or `protocols 2 to 3`."""
        if self.lowest == self.highest:
            return f"protocol {self.highest}"
        return f"protocols {self.lowest} to {self.highest}"

    def common(self, other: "Protocols") -> int | None:
        """Return the highest number that is in both ranges; None where there is none."""
        lowest, highest = max(self.lowest, other.lowest), min(self.highest, other.highest)
        return highest if lowest <= highest else None


RENAMED_FIELDS: Mapping[int, Mapping[str, Mapping[str, str]]] = {
    2: {
        "Call/1": {"verb": "method"},
        "CallRecord/1": {"verb": "method"},
        "CallRequest/1": {"verb": "method"},
        "Detections/1": {"kinds": "types"},
        "Fault/1": {"kind": "type"},
        "Goal/1": {"kind": "type"},
        "Trigger/1": {"upto": "step_limit"},
    }
}
"""Protocol number → type → name of a field below that number → its name from it on."""

SPOKEN = Protocols(PROTOCOL_VERSION, PROTOCOL_VERSION)
"""What a participant of this library speaks."""
SERVED = Protocols(1, PROTOCOL_VERSION)
"""What an orchestrator speaks to participants whose port types no number has changed."""
BEFORE_RANGES = Protocols(2, 2)
"""What an orchestrator speaks whose ticket has no `protocols`."""


def served(types: Iterable[str]) -> Protocols:
    """Return the numbers in which a participant may take part whose ports are of some types.

    Participants send each other their messages directly. So one of an earlier number can have no
    port of a type that has been renamed since: its peers would not understand it.
    """
    ports = set(types)
    lowest = (number for number, renamed in RENAMED_FIELDS.items() if ports & renamed.keys())
    return Protocols(max([SERVED.lowest, *lowest]), SERVED.highest)


def offered(hello: Hello) -> Protocols:
    """Return the numbers that a program speaks."""
    lowest = hello.lowest_protocol
    return Protocols(hello.protocol if lowest is None else lowest, hello.protocol)


_fields = msgspec.msgpack.Decoder(dict[str, msgspec.Raw]).decode
_encode = msgspec.msgpack.Encoder().encode


def renamed_fields(type_name: str) -> dict[str, str]:
    """Return the earlier names of a type's fields: earlier → present."""
    return {
        earlier: present
        for renamed in RENAMED_FIELDS.values()
        for earlier, present in renamed.get(type_name, {}).items()
    }


def with_present_names(data: bytes, renamed: Mapping[str, str]) -> bytes:
    """Return a message with the present names of its fields; renamed: earlier → present.

    What is no map is returned as it is.
    """
    try:
        fields = _fields(data)
    except msgspec.MsgspecError:
        return data
    if renamed.keys().isdisjoint(fields):
        return data
    return _encode({renamed.get(name, name): value for name, value in fields.items()})


def with_earlier_names(data: bytes, renamed: Mapping[str, str]) -> bytes:
    """Return a message of ours that programs of every number read: its fields with both names."""
    fields = _fields(data)
    earlier = {name: fields[now] for name, now in renamed.items() if now in fields}
    return _encode(fields | earlier) if earlier else data
