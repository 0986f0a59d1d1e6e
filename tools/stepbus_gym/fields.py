"""Which numbers a message type holds: what of it fits into a vector."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec
import numpy as np

from stepbus_schemas import Message, parts_of, row_of

_NUMBERS = ("float", "int", "bool")


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

    scalar: type of an entry, as a declaration names it; empty: it is nested. sizes: of an array;
    `n`: one for each name of the port's description. unit: of the type. words: allowed ones.
    """

    name: str
    scalar: str
    sizes: tuple[str, ...]
    is_required: bool
    unit: str
    words: tuple[str, ...]

    @property
    def fits(self) -> bool:
        """Return whether it always has the same number of numbers, or truth values."""
        return self.scalar in _NUMBERS and all(n.isdigit() or n == "n" for n in self.sizes)

    def shape(self, count: int) -> tuple[int, ...]:
        """Return its shape, for so many names."""
        return tuple(int(n) if n.isdigit() else count for n in self.sizes)

    def neutral(self, count: int) -> Any:
        """Return what means as little as possible: zeros, an empty text, the first word."""
        if self.words:
            return self.words[0]
        if self.scalar not in _NUMBERS:
            return [] if self.sizes else ""
        return np.zeros(self.shape(count)).tolist()


@cache
def forms(cls: type[Message]) -> dict[str, Form]:
    """Return what each field of a message type may hold."""
    _, parts = msgspec.json.schema_components([cls], ref_template="{name}")
    schema = parts[cls.__name__]
    required = schema.get("required", [])
    return {
        name: _form(name, node, required=name in required)
        for name, node in schema["properties"].items()
    }


def _form(name: str, node: dict[str, Any], *, required: bool) -> Form:
    try:
        form = row_of(node, required=required)["type"]
        scalar, sizes = parts_of(form)
    except (ValueError, KeyError, TypeError):
        form, scalar, sizes = "", "", []
    return Form(
        name=name,
        scalar=scalar,
        sizes=tuple(sizes),
        is_required=required,
        unit=node.get("unit", ""),
        words=tuple(form) if scalar == "words" else (),
    )


def entries(shape: tuple[int, ...], names: list[str]) -> Iterator[str]:
    """Yield what to call each number of an array: by name along its first axis where it has one."""
    if not shape:
        yield ""
        return
    width = math.prod(shape[1:])
    for index in range(shape[0] * width):
        first = names[index // width] if len(names) == shape[0] else str(index // width)
        yield first if width == 1 else f"{first},{index % width}"
