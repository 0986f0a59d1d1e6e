"""Which numbers a message type holds: what of it fits into a vector."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import inspect

from stepbus_schemas import Message

_NUMBERS = (inspect.FloatType, inspect.IntType, inspect.BoolType)
SLIDING = {"rad": "m", "rad/s": "m/s", "rad/s²": "m/s²", "N·m": "N"}
"""Unit of a joint that turns → of one that slides."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """One number of an observation or an action.

    name: `joint_state.position[joint1]`. port, field: where it stands. entry: the name of its
    joint, or its index. unit: as the port describes it. low, high: what its port describes;
    infinite: nothing.
    """

    name: str
    port: str
    field: str
    entry: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Form:
    """What one field of a message type may hold.

    sizes: of an array; `n`: one for each name of the port's description. is_number: whether it
    holds numbers, or truth values. unit: of the type.
    """

    name: str
    sizes: tuple[int | str, ...]
    is_number: bool
    is_required: bool
    unit: str
    words: tuple[Any, ...]

    @property
    def fits(self) -> bool:
        """Return whether it always has the same number of numbers."""
        return self.is_number and all(isinstance(n, int) or n == "n" for n in self.sizes)

    def shape(self, count: int) -> tuple[int, ...]:
        """Return its shape, for so many names."""
        return tuple(n if isinstance(n, int) else count for n in self.sizes)

    def neutral(self, count: int) -> Any:
        """Return what means as little as possible: zeros, an empty text, the first word."""
        if self.words:
            return self.words[0]
        if not self.is_number:
            return [] if self.sizes else ""
        return np.zeros(self.shape(count)).tolist()


def forms(cls: type[Message]) -> dict[str, Form]:
    """Return what each field of a message type may hold."""
    info = inspect.type_info(cls)
    fields = info.fields if isinstance(info, inspect.StructType) else ()
    return {field.name: _form(field) for field in fields}


def _form(field: inspect.Field) -> Form:
    node, extra = _bare(field.type)
    names = iter(extra.get("shape", ()))
    sizes: list[int | str] = []
    while isinstance(node, inspect.TupleType | inspect.ListType | inspect.VarTupleType):
        size = next(names, "k")
        if isinstance(node, inspect.TupleType):
            sizes.append(len(node.item_types))
            node, _ = _bare(node.item_types[0])
        else:
            sizes.append(size)
            node, _ = _bare(node.item_type)
    return Form(
        name=field.name,
        sizes=tuple(sizes),
        is_number=isinstance(node, _NUMBERS),
        is_required=field.required,
        unit=str(extra.get("unit", "")),
        words=node.values if isinstance(node, inspect.LiteralType) else (),
    )


def _bare(node: inspect.Type) -> tuple[inspect.Type, Mapping[str, Any]]:
    """Return a type without its metadata and without None, and the metadata."""
    extra: Mapping[str, Any] = {}
    if isinstance(node, inspect.Metadata):
        extra = node.extra_json_schema or {}
        node = node.type
    if isinstance(node, inspect.UnionType):
        node = next(one for one in node.types if not isinstance(one, inspect.NoneType))
    return node, extra


def entries(shape: tuple[int, ...], names: list[str]) -> Iterator[str]:
    """Yield what to call each number of an array: by name along its first axis where it has one."""
    if not shape:
        yield ""
        return
    width = math.prod(shape[1:])
    for index in range(shape[0] * width):
        first = names[index // width] if len(names) == shape[0] else str(index // width)
        yield first if width == 1 else f"{first},{index % width}"
