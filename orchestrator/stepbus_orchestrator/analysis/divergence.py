"""What comparing the messages of a port finds, and how it reads."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from functools import cached_property, partial
from typing import Any, Literal, get_args

import msgspec

from stepbus_orchestrator.analysis.tolerance import (
    Difference,
    FieldTolerance,
    Tolerance,
    difference,
    differences,
    short,
)
from stepbus_schemas import SHIPPED, Decoder, MessageError, Types, WiringError, json_schema
from stepbus_schemas.messages import JointMode

_INDEX = re.compile(r"\[(\d+)\]")
_MOST_VALUES = 12
DivergenceType = Literal["value", "encoding", "missing", "added"]


class Divergence(msgspec.Struct, frozen=True, kw_only=True):
    """Where two recordings diverge.

    field: with its index, e.g. `values[1]`; empty for a whole message. name: of that index in the
    port's description, e.g. `joint2`; empty where it has none. type: `value`: both are
    there and differ; `encoding`: the same values in other bytes; `missing`, `added`: only the
    first, or only the second, has a message. first, second: both values.
    """

    step: int
    topic: str
    type: DivergenceType
    field: str = ""
    name: str = ""
    first: Any = None
    second: Any = None

    def text(self, first: str = "first", second: str = "second") -> str:
        """Return the divergence in words; first, second: names of the two sides."""
        return f"step {self.step}: {self.detail(first, second)}"

    def detail(self, first: str, second: str) -> str:
        """Return the divergence in words, without the step."""
        match self.type:
            case "encoding":
                what = "same values, different bytes; to compare values, use "
                what += f"--abs {self.topic}=0"
            case "missing":
                what = f"the {first} has a message, the {second} has none"
            case "added":
                what = f"the {second} has a message, the {first} has none"
            case "value":
                gap = difference(self.first, self.second)
                what = f"{_named(self.field, self.name)}: " if self.field else ""
                what += f"{first} {short(self.first)}, {second} {short(self.second)}"
                what += "" if gap is None else f" (difference {gap:.3g})"
        return f"{self.topic}: {what}"


class FieldCount(msgspec.Struct, kw_only=True):
    """How much one field of a port differs.

    different: messages in which it is not equal to the bit. beyond: those in which it is beyond
    the tolerance. largest: largest |first − second| of its numbers; at_step, at: where that is;
    name: of its index, as in `Divergence`.
    """

    field: str
    different: int = 0
    beyond: int = 0
    largest: float = 0.0
    at_step: int = -1
    at: str = ""
    name: str = ""

    def take(self, step: int, values: Sequence[Difference], name_of: Callable[[str], str]) -> None:
        """Count the differences of one message."""
        self.different += 1
        self.beyond += any(item.beyond for item in values)
        for item in values:
            size = difference(item.first, item.second)
            if size is not None and size > self.largest:
                self.largest, self.at_step, self.at = size, step, item.path
                self.name = name_of(item.path)


class PortResult(msgspec.Struct, frozen=True, kw_only=True):
    """The comparison of one port.

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


def in_order(results: Iterable[PortResult]) -> list[PortResult]:
    """Return the results by the step of their first divergence; equal ones come last."""
    return sorted(results, key=lambda r: r.divergence.step if r.divergence else math.inf)


def port_lines(
    port: PortResult, first: str, second: str, shown: Divergence | None
) -> Iterator[str]:
    """Return the lines of one port.

    first, second: names of the two sides. shown: a divergence that was shown already.
    """
    total = port.equal + port.within + port.different
    parts = {
        f"{total} messages equal": total == port.equal,
        f"{port.different} of {total} messages differ": total != port.equal,
        f"{port.within} are within the tolerance": port.within,
        f"{port.missing} only in the {first}": port.missing,
        f"{port.added} only in the {second}": port.added,
    }
    yield f"{port.topic}: {', '.join(text for text, is_so in parts.items() if is_so)}"
    if port.divergence is not None and port.divergence is not shown:
        yield f"  {port.divergence.text(first, second)}"
    for count in port.fields:
        yield f"  {_field(count)}"


def _field(count: FieldCount) -> str:
    text = f"{count.field}: differs in {count.different} messages"
    if count.beyond < count.different:
        text += f", beyond the tolerance in {count.beyond}"
    if count.largest:
        where = f"{_named(count.at, count.name)} at step {count.at_step}"
        text += f"; largest difference {count.largest:.3g} ({where})"
    return text


def _named(path: str, name: str) -> str:
    """Return a path with the name of its first index: `values[1]`, `joint2` → `values[joint2]`."""
    return _INDEX.sub(lambda _: f"[{name}]", path, count=1) if name else path


class PortComparison:
    """Compares one port, message by message in the order of their steps.

    type_name: a message type, `Name/major`; an unknown one is compared as plain MessagePack.
    types: of the scenario or recording. names: of the port's description. decode: decodes its
    messages. divergence: the first one so far.
    """

    def __init__(
        self,
        topic: str,
        type_name: str,
        tolerance: Tolerance,
        types: Types = SHIPPED,
        *,
        names: Sequence[str] = (),
    ) -> None:
        self.topic = topic
        self.type_name = type_name
        self.divergence: Divergence | None = None
        self.decode = _decoder(type_name, types)
        self._types, self._names = types, names
        self._tolerance = tolerance
        self._fields: dict[str, FieldTolerance | None] = {}
        self._counts: dict[str, FieldCount] = {}
        self._messages = dict.fromkeys(("equal", "within", "different", "missing", "added"), 0)

    def take(self, step: int, first: bytes | None, second: bytes | None) -> bool:
        """Compare the messages of one step, None for none; return whether they count as equal."""
        if first == second:
            self._messages["equal"] += first is not None
            return True
        divergence: Divergence | None
        if first is None or second is None:
            divergence = self._one_sided(step, first, second)
        else:
            divergence = self._compare(step, first, second)
            self._messages["different" if divergence else "within"] += 1
        self.divergence = self.divergence or divergence
        return divergence is None

    def plain(self, data: bytes) -> Any:
        """Return a message as plain values; the bytes in hexadecimal where they are none."""
        try:
            return msgspec.to_builtins(self.decode(data))
        except (MessageError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            return data.hex()

    def beside(self, first: bytes | None, second: bytes | None) -> str:
        """Return the second message in words, as `value | first (difference)` where they differ."""
        one = {} if first is None else dict(_leaves("", self.plain(first)))
        other = {} if second is None else dict(_leaves("", self.plain(second)))
        texts: list[str] = []
        for path in dict.fromkeys((*other, *one)):
            value, was = other.get(path), one.get(path)
            texts.append(f"{_named(path, self._name_of(path))} {_brief(value)}")
            if first != second and value != was:
                gap = difference(was, value)
                texts[-1] += f" | {_brief(was)}" + ("" if gap is None else f" ({gap:.3g})")
            texts[-1] += self._unit(path, other)
        more = ", …" if len(texts) > _MOST_VALUES else ""
        same = " as recorded" if first == second else ""
        return f"{same}: {', '.join(texts[:_MOST_VALUES])}{more}"

    def result(self) -> PortResult:
        """Return the comparison so far."""
        return PortResult(
            topic=self.topic,
            type=self.type_name,
            fields=tuple(map(copy, self._counts.values())),
            divergence=self.divergence,
            **self._messages,
        )

    def _one_sided(self, step: int, first: bytes | None, second: bytes | None) -> Divergence:
        side: DivergenceType = "missing" if second is None else "added"
        self._messages[side] += 1
        one, other = (None if data is None else self.plain(data) for data in (first, second))
        return Divergence(step=step, topic=self.topic, type=side, first=one, second=other)

    def _compare(self, step: int, first: bytes, second: bytes) -> Divergence | None:
        """Return the first field beyond its tolerance, None where there is none."""
        one, other = self.plain(first), self.plain(second)
        differs = partial(Divergence, step=step, topic=self.topic)
        if not isinstance(one, dict) or not isinstance(other, dict):
            return differs(type="value", first=one, second=other)
        is_explained = self._tolerance.concerns(self.topic)
        beyond: list[Difference] = []
        for name in dict.fromkeys((*one, *other)):
            values = list(differences(name, one.get(name), other.get(name), self._allowed(name)))
            if values:
                is_explained = True
                count = self._counts.setdefault(name, FieldCount(field=name))
                count.take(step, values, self._name_of)
                beyond += [item for item in values if item.beyond]
        if beyond:
            path, first_value, second_value, _ = msgspec.structs.astuple(beyond[0])
            name = self._name_of(path)
            return differs(
                type="value", field=path, name=name, first=first_value, second=second_value
            )
        return None if is_explained else differs(type="encoding")

    def _name_of(self, path: str) -> str:
        """Return the name of the index in a path such as `values[1]`; nothing where it has none."""
        match = _INDEX.search(path)
        if match is None or int(match[1]) >= len(self._names):
            return ""
        return self._names[int(match[1])] if path[: match.start()] in self._per_name else ""

    @cached_property
    def _schema(self) -> Mapping[str, Any]:
        known = fields_of(self.type_name, self._types)
        return json_schema(self.type_name, self._types)["properties"] if known else {}

    @cached_property
    def _per_name(self) -> set[str]:
        """Return the fields that have one value for each name of the port's description."""
        fields = self._schema.items()
        return {name for name, field in fields if field.get("shape", [])[:1] == ["n"]}

    def _unit(self, path: str, message: Mapping[str, Any]) -> str:
        """Return the unit of a field, after a space; some have one for each mode."""
        units = self._schema.get(path.partition("[")[0], {}).get("unit", "").split(", ")
        modes, mode = get_args(JointMode), message.get("mode")
        unit = units[modes.index(mode)] if len(units) == len(modes) and mode in modes else units[0]
        return "" if unit in {"", "-"} else f" {unit}"

    def _allowed(self, name: str) -> FieldTolerance | None:
        if name not in self._fields:
            self._fields[name] = self._tolerance.of(self.topic, name)
        return self._fields[name]


def _leaves(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield path → value of all that is in a message, but for what is absent."""
    if isinstance(value, dict | list | tuple):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(f"{path}[{key}]" if path else str(key), part)
    elif value is not None:
        yield path, value


def _brief(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "-" if value is None else short(value)


def fields_of(type_name: str, types: Types = SHIPPED) -> tuple[str, ...]:
    """Return the fields of a message type; none for an unknown type."""
    try:
        return types[type_name].__struct_fields__
    except WiringError:
        return ()


def _decoder(type_name: str, types: Types) -> Callable[[bytes], Any]:
    """Return the decoder of a message type, or one of any MessagePack for an unknown type."""
    try:
        return Decoder(types[type_name])
    except WiringError:
        return msgspec.msgpack.Decoder().decode
