"""The numbers in messages of any type, also of a user's own, as curves have them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stepbus_tools.viewing.scene import Messages

_MOST = 16
"""Curves of one signal; more cannot be told apart."""


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A field of a port that has numbers. names: of its components."""

    topic: str
    field: str
    names: tuple[str, ...]

    @property
    def label(self) -> str:
        """Return its name, as `stepbus plot` has it."""
        return f"{self.topic.replace('/', '.', 1)}.{self.field}"


def signals(messages: Messages, names: dict[str, Sequence[str]]) -> list[Signal]:
    """Return the signals in the newest messages. names: of the vectors of each port."""
    found = []
    for topic, latest in messages.items():
        for field in latest.message.__struct_fields__:
            values = numbers(getattr(latest.message, field))
            if values:
                own = tuple(names.get(topic, ()))
                shown = own if len(own) == len(values) else tuple(map(str, range(len(values))))
                found.append(Signal(topic=topic, field=field, names=shown[:_MOST]))
    return found


def numbers(value: object) -> list[float]:
    """Return a number, or a vector of them, as a list; nothing for anything else."""
    if isinstance(value, bool):
        return [float(value)]
    if isinstance(value, int | float):
        return [float(value)]
    if isinstance(value, list | tuple) and value and not isinstance(value[0], list | tuple | str):
        found = [number for item in value[:_MOST] for number in numbers(item)]
        return found if len(found) == min(len(value), _MOST) else []
    return []


def value_of(signal: Signal, message: Any) -> list[float]:
    """Return the components of a signal in a message; NaN for what is absent."""
    found = numbers(getattr(message, signal.field, None))[: len(signal.names)]
    return found + [math.nan] * (len(signal.names) - len(found))
