"""Format `raw` of the bridge: messages as numbers alone."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args

from .catalogue import SHIPPED, Types
from .declaration import Row, parts_of, row_of
from .messages import JointCommand, JointMode, JointState, Message
from .schema import json_schema

_FIRST_ONLY: Mapping[type[Message], tuple[str, ...]] = {
    JointState: ("position", "velocity", "effort"),
    JointCommand: ("mode", "values"),
}
"""Fields of the types whose layout is older than some of their fields."""
_WORDS: Mapping[type[Message], Sequence[str]] = {JointCommand: get_args(JointMode)}
PER_NAME, ANY_LENGTH = "n", "shape[0]"
BRIDGE_VERSION = 2
"""Number in the first message of the bridge. It rises with changes that a program behind the bridge
would not understand, and not with the protocol number."""


@dataclass(frozen=True, kw_only=True)
class RawField:
    """A field as numbers.

    sizes: of an array, with `n` for the number of names of the port's description and `shape[0]`
    for the first of its `shape`. words: those that the numbers 0, 1 … stand for. scalar: `float`,
    `int`, `bool` or `words`. absent: its value where all numbers are NaN; it may be there unless
    `may_be_absent`.
    """

    name: str
    scalar: str
    sizes: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    may_be_absent: bool = False
    absent: Any = None

    def __str__(self) -> str:
        """Return the field as documented: `values (n)`, `mode (0 torque, 1 velocity)`."""
        rows = [f"{number} {word}" for number, word in enumerate(self.words)]
        inner = " · ".join(self.sizes) or ", ".join(rows)
        return f"{self.name} ({inner})" if inner else self.name


@cache
def _raw_fields(cls: type[Message], type_name: str) -> tuple[RawField, ...]:
    """Return the fields of a type as numbers; none where one of them is more than numbers."""
    schema = json_schema(type_name, SHIPPED if type_name in SHIPPED else Types.of([cls]))
    try:
        return tuple(
            _raw_field(cls, name, row_of(field, required=name in schema["required"]))
            for name, field in schema["properties"].items()
            if name in _FIRST_ONLY.get(cls, (name,))
        )
    except ValueError:
        return ()


def _raw_field(cls: type[Message], name: str, row: Row) -> RawField:
    """Return a field, as it is declared, as numbers; raises ValueError where it is more."""
    scalar, given = parts_of(row["type"])
    sizes = [size if size.isdigit() or size == PER_NAME else ANY_LENGTH for size in given]
    if scalar in {"text", "bytes"} or not all(map(str.isdigit, sizes[1:])):
        raise ValueError(f"{name} has fields that are not numbers")
    default = row.get("default")
    return RawField(
        name=name,
        scalar=scalar,
        sizes=tuple(sizes),
        words=tuple(_WORDS.get(cls, row["type"])) if scalar == "words" else (),
        may_be_absent="optional" in row or default == [],
        absent=default,
    )


def raw_fields(type_name: str, types: Types = SHIPPED) -> tuple[RawField, ...]:
    """Return the fields of a message type as numbers; none of a type that is more than numbers."""
    return _raw_fields(types[type_name], type_name) if type_name in types else ()


class RawLayout:
    """The numbers of the messages of one port.

    names: how many the port's description has. length: the first of its `shape`, 0 for none.
    width: how many numbers a message has.
    """

    def __init__(
        self, type_name: str, types: Types = SHIPPED, *, names: int = 0, length: int = 0
    ) -> None:
        self.fields = raw_fields(type_name, types)
        self._cls = types[type_name]
        self._lengths = {PER_NAME: names, ANY_LENGTH: length}
        self._rows = [(field, *self._sizes(field)) for field in self.fields]
        self.width = sum(first * each for _, first, each in self._rows)

    def lacks(self) -> Iterator[str]:
        """Yield which of `names` and `shape` the port's description lacks, to know its width."""
        for size, key in ((PER_NAME, "names"), (ANY_LENGTH, "shape")):
            if not self._lengths[size] and any(size in field.sizes for field in self.fields):
                yield key

    def _sizes(self, field: RawField) -> tuple[int, int]:
        """Return the length of a field's first dimension, and how many numbers an entry has."""
        sizes = [
            self._lengths.get(size) or (0 if size in self._lengths else int(size))
            for size in field.sizes
        ]
        return (sizes[0], math.prod(sizes[1:])) if sizes else (1, 1)

    def flatten(self, message: Message, order: Sequence[int] = ()) -> list[float]:
        """Return the numbers of a message; raises ValueError where its lengths do not fit.

        order: index of the entry of each vector of names that comes first, second …; empty:
        unchanged.
        """
        numbers: list[float] = []
        for field, first, each in self._rows:
            value = getattr(message, field.name)
            if value is None or (field.may_be_absent and value == field.absent):
                numbers += [math.nan] * (first * each)
            elif not field.sizes:
                numbers.append(float(field.words.index(value)) if field.words else float(value))
            else:
                entries = (
                    [value[i] for i in order] if order and field.sizes[0] == PER_NAME else value
                )
                if len(value) != first:
                    raise ValueError(
                        f"{field.name} has {len(value)} numbers for {first} {_what(field)}"
                    )
                numbers += entries if each == 1 and len(field.sizes) == 1 else _flat(entries)
        return numbers

    def unflatten(self, numbers: Sequence[float]) -> Message:
        """Return the message that numbers stand for; raises ValueError where they are none."""
        values: dict[str, Any] = {}
        start = 0
        for field, first, each in self._rows:
            part = numbers[start : start + first * each]
            start += first * each
            if field.may_be_absent and all(map(math.isnan, part)):
                values[field.name] = field.absent
            else:
                # Each number alone would take three times as long; most fields are floats.
                is_float = field.scalar == "float"
                scalars = list(part) if is_float else [_scalar(field, item) for item in part]
                values[field.name] = _nested(scalars, field)
        return self._cls(**values)


def _what(field: RawField) -> str:
    return {PER_NAME: "names", ANY_LENGTH: "of its shape"}.get(field.sizes[0], "entries")


def _flat(value: Any) -> list[float]:
    if isinstance(value, list | tuple):
        return [number for item in value for number in _flat(item)]
    return [float(value)]


def _scalar(field: RawField, number: float) -> Any:
    match field.scalar:
        case "words":
            if number not in range(len(field.words)):
                last = len(field.words) - 1
                text = f"0 ({field.words[0]}) … {last} ({field.words[last]})"
                raise ValueError(f"{field.name} {number:g} is none of {text}")
            return field.words[int(number)]
        case "bool":
            if number not in (0, 1):
                raise ValueError(f"{field.name} is {number:g}, not 0 or 1")
            return bool(number)
        case _:
            if not number.is_integer():
                raise ValueError(f"{field.name} is {number:g}, not a whole number")
            return int(number)


def _nested(values: list[Any], field: RawField) -> Any:
    """Return the values of a field as its type nests them: lists by name, tuples of fixed size."""
    if not field.sizes:
        return values[0]
    nested: Any = values
    for size in reversed(field.sizes[1:]):
        count = int(size)
        nested = [tuple(nested[i : i + count]) for i in range(0, len(nested), count)]
    return tuple(nested) if field.sizes[0].isdigit() else nested


BridgeFormat = Literal["json", "msgpack", "raw"]

BRIDGE_FORMATS: tuple[str, ...] = get_args(BridgeFormat)


def raw_problem(
    publishes: str,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    types: Types = SHIPPED,
) -> str:
    """Return why format `raw` cannot carry a participant; empty where it can.

    inputs, outputs: port → message type. types: of the scenario.
    """
    if publishes == "first":
        return "format raw cannot publish first; use json or msgpack"
    ports = [*inputs.items(), *outputs.items()]
    others = [
        f"{name} ({type_name})"
        for name, type_name in ports
        if type_name in types and not raw_fields(type_name, types)
    ]
    if others:
        return (
            f"format raw carries only types made of numbers, not {', '.join(others)}; remove that "
            "port, or use json or msgpack"
        )
    return "" if outputs else "format raw needs an output: the program's answer"
