"""Compares two messages of one port, and keeps count of what differs in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal

import msgspec

from stepbus_schemas import Decoder, MessageError, WiringError, message_class

from .tolerance import Slack, Tolerance

Kind = Literal["value", "encoding", "missing", "added"]

_SHOWN_CHARACTERS = 300
_decode_any = msgspec.msgpack.Decoder().decode


class Divergence(msgspec.Struct, frozen=True, kw_only=True):
    """Where two recordings part.

    field: with its index, e.g. `values[1]`; empty for a whole message. kind: `value`: both are
    there and differ; `encoding`: the same values in other bytes; `missing`, `added`: only the
    first, or only the second, has a message. first, second: both values.
    """

    step: int
    topic: str
    kind: Kind
    field: str = ""
    first: Any = None
    second: Any = None

    def text(self, first: str = "first", second: str = "second") -> str:
        """Return it in words; first, second: what the two sides are called."""
        where = f"step {self.step}: {self.topic}"
        match self.kind:
            case "encoding":
                return (
                    f"{where}: the same values in other bytes; "
                    f"give a tolerance to compare values, e.g. --abs {self.topic}=0"
                )
            case "missing":
                return f"{where}: the {first} has a message, the {second} has none"
            case "added":
                return f"{where}: the {second} has a message, the {first} has none"
        if not self.field:
            return f"{where}: {first} {short(self.first)}, {second} {short(self.second)}"
        apart = difference(self.first, self.second)
        by = "" if apart is None else f" (difference {apart:.3g})"
        return (
            f"{where}: {self.field}: {first} {short(self.first)}, {second} {short(self.second)}{by}"
        )


class FieldCount(msgspec.Struct, frozen=True, kw_only=True):
    """How far one field of a port is apart.

    different: messages in which it is not equal to the bit. beyond: those in which it is beyond
    the tolerance. largest: largest |first − second| of its numbers; at_step, at: where that is.
    """

    field: str
    different: int
    beyond: int
    largest: float
    at_step: int
    at: str


class PortResult(msgspec.Struct, frozen=True, kw_only=True):
    """What comparing one port came to.

    equal: messages equal to the byte. within: others that are within the tolerance. different:
    messages that are not. missing, added: messages only the first, or only the second, has.
    divergence: the first one.
    """

    topic: str
    type: str
    equal: int
    within: int
    different: int
    missing: int
    added: int
    fields: tuple[FieldCount, ...]
    divergence: Divergence | None

    @property
    def first_step(self) -> float:
        """Return the step of the first divergence; infinity without one."""
        return math.inf if self.divergence is None else self.divergence.step


class _Count:
    """A `FieldCount` that grows."""

    def __init__(self) -> None:
        self.different = 0
        self.beyond = 0
        self.largest = 0.0
        self.at_step = -1
        self.at = ""

    def take(self, step: int, differences: list[_Difference]) -> None:
        self.different += 1
        self.beyond += any(item.beyond for item in differences)
        for item in differences:
            apart = difference(item.first, item.second)
            if apart is not None and apart > self.largest:
                self.largest, self.at_step, self.at = apart, step, item.path


class _Difference(msgspec.Struct, frozen=True):
    """Two values that are not equal to the bit."""

    path: str
    first: Any
    second: Any
    beyond: bool


class PortComparison:
    """Compares one port, message by message in the order of their steps.

    type_name: a message type, `Name/major`; an unknown one is compared as plain MessagePack.
    """

    def __init__(self, topic: str, type_name: str, tolerance: Tolerance) -> None:
        self.topic = topic
        self.type_name = type_name
        self.divergence: Divergence | None = None
        self.decode = decoder(type_name)
        self._tolerance = tolerance
        self._by_value = tolerance.concerns(topic)
        self._slacks: dict[str, Slack | None] = {}
        self._counts: dict[str, _Count] = {}
        self._equal = self._within = self._different = self._missing = self._added = 0

    def take(self, step: int, first: bytes | None, second: bytes | None) -> bool:
        """Compare the messages of one step, None for none; return whether they count as equal."""
        if first == second:
            self._equal += first is not None
            return True
        if first is None or second is None:
            return self._one_sided(step, first, second)
        found = self._compare(step, first, second)
        if found is None:
            self._within += 1
            return True
        self._different += 1
        self._note(found)
        return False

    def _one_sided(self, step: int, first: bytes | None, second: bytes | None) -> bool:
        kind: Kind = "missing" if second is None else "added"
        self._missing += second is None
        self._added += first is None
        values = [None if data is None else self.plain(data) for data in (first, second)]
        self._note(
            Divergence(step=step, topic=self.topic, kind=kind, first=values[0], second=values[1])
        )
        return False

    def _note(self, found: Divergence) -> None:
        self.divergence = self.divergence or found

    def _compare(self, step: int, first: bytes, second: bytes) -> Divergence | None:
        """Return the first field beyond its tolerance, None where there is none."""
        one, other = self.plain(first), self.plain(second)
        if not isinstance(one, dict) or not isinstance(other, dict):
            return Divergence(step=step, topic=self.topic, kind="value", first=one, second=other)
        worst: _Difference | None = None
        any_difference = False
        for name in dict.fromkeys((*one, *other)):
            found = list(differences(name, one.get(name), other.get(name), self._slack(name)))
            if found:
                any_difference = True
                self._counts.setdefault(name, _Count()).take(step, found)
                worst = worst or next((item for item in found if item.beyond), None)
        if worst is None:
            unexplained = not any_difference and not self._by_value
            return self._encoding(step) if unexplained else None
        return Divergence(
            step=step,
            topic=self.topic,
            kind="value",
            field=worst.path,
            first=worst.first,
            second=worst.second,
        )

    def _encoding(self, step: int) -> Divergence:
        return Divergence(step=step, topic=self.topic, kind="encoding")

    def _slack(self, name: str) -> Slack | None:
        if name not in self._slacks:
            self._slacks[name] = self._tolerance.slack(self.topic, name)
        return self._slacks[name]

    def plain(self, data: bytes) -> Any:
        """Return a message as plain values; the bytes in hexadecimal where they are none."""
        try:
            return msgspec.to_builtins(self.decode(data))
        except (MessageError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            return data.hex()

    def result(self) -> PortResult:
        """Return what it has come to."""
        return PortResult(
            topic=self.topic,
            type=self.type_name,
            equal=self._equal,
            within=self._within,
            different=self._different,
            missing=self._missing,
            added=self._added,
            fields=tuple(_field_count(name, count) for name, count in self._counts.items()),
            divergence=self.divergence,
        )


def _field_count(name: str, count: _Count) -> FieldCount:
    return FieldCount(
        field=name,
        different=count.different,
        beyond=count.beyond,
        largest=count.largest,
        at_step=count.at_step,
        at=count.at,
    )


def decoder(type_name: str) -> Callable[[bytes], Any]:
    """Return the decoder of a message type, or one of any MessagePack for an unknown type."""
    try:
        return Decoder(message_class(type_name))
    except WiringError:
        return _decode_any


def differences(path: str, one: Any, other: Any, slack: Slack | None) -> Iterator[_Difference]:
    """Return every pair of values that are not equal to the bit, with the index of each.

    slack: None: each of them is beyond the tolerance.
    """
    if isinstance(one, dict) and isinstance(other, dict):
        for key in dict.fromkeys((*one, *other)):
            yield from differences(f"{path}.{key}", one.get(key), other.get(key), slack)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for index, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from differences(f"{path}[{index}]", a, b, slack)
    elif not _same(one, other):
        yield _Difference(path, one, other, not _allowed(one, other, slack))


def _same(one: Any, other: Any) -> bool:
    """Return whether two values are equal to the bit, any two NaN included."""
    if isinstance(one, float) and isinstance(other, float):
        if math.isnan(one):
            return math.isnan(other)
        return one == other and math.copysign(1.0, one) == math.copysign(1.0, other)
    return type(one) is type(other) and bool(one == other)


def _allowed(one: Any, other: Any, slack: Slack | None) -> bool:
    if slack is None:
        return False
    if _is_number(one) and _is_number(other):
        return slack.allows(one, other)
    return slack.ignore


def difference(one: Any, other: Any) -> float | None:
    """Return |one − other| of two numbers; None where that is no number."""
    if not (_is_number(one) and _is_number(other)):
        return None
    apart = abs(float(one) - float(other))
    return None if math.isnan(apart) else apart


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def short(value: Any) -> str:
    """Return a value as text that fits into a line or two."""
    text = repr(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}…"


def fields_of(type_name: str) -> tuple[str, ...]:
    """Return the fields of a message type; none for an unknown type."""
    try:
        return message_class(type_name).__struct_fields__
    except WiringError:
        return ()


def in_order(results: Iterable[PortResult]) -> list[PortResult]:
    """Return the results by the step of their first divergence; equal ones come last."""
    return sorted(results, key=lambda result: result.first_step)
