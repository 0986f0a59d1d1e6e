"""What comparing the messages of a port finds, and how it reads."""

import math
from collections.abc import Iterable, Iterator
from typing import Any, Literal

import msgspec

from stepbus_orchestrator.errors import argument

from .values import difference, short

DivergenceType = Literal["value", "encoding", "missing", "added"]


class Divergence(msgspec.Struct, frozen=True, kw_only=True):
    """Where two recordings diverge.

    field: with its index, e.g. `values[1]`; empty for a whole message. type: `value`: both are
    there and differ; `encoding`: the same values in other bytes; `missing`, `added`: only the
    first, or only the second, has a message. first, second: both values.
    """

    step: int
    topic: str
    type: DivergenceType
    field: str = ""
    first: Any = None
    second: Any = None

    def text(self, first: str = "first", second: str = "second") -> str:
        """Return it in words; first, second: names of the two sides."""
        where = f"step {self.step}: {self.topic}"
        match self.type:
            case "encoding":
                return (
                    f"{where}: the same values in other bytes; "
                    f"give {argument(f'--abs {self.topic}=0', 'tolerance')} to compare values"
                )
            case "missing":
                return f"{where}: the {first} has a message, the {second} has none"
            case "added":
                return f"{where}: the {second} has a message, the {first} has none"
        if not self.field:
            return f"{where}: {first} {short(self.first)}, {second} {short(self.second)}"
        found = difference(self.first, self.second)
        by = "" if found is None else f" (difference {found:.3g})"
        return (
            f"{where}: {self.field}: {first} {short(self.first)}, {second} {short(self.second)}{by}"
        )


class FieldCount(msgspec.Struct, frozen=True, kw_only=True):
    """How much one field of a port differs.

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

    @property
    def first_step(self) -> float:
        """Return the step of the first divergence; infinity without one."""
        return math.inf if self.divergence is None else self.divergence.step


def in_order(results: Iterable[PortResult]) -> list[PortResult]:
    """Return the results by the step of their first divergence; equal ones come last."""
    return sorted(results, key=lambda result: result.first_step)


def port_lines(
    port: PortResult, first: str, second: str, shown: Divergence | None
) -> Iterator[str]:
    """Return the lines of one port.

    first, second: names of the two sides. shown: a divergence that was shown already.
    """
    yield f"{port.topic}: {', '.join(_parts(port, first, second))}"
    if port.divergence is not None and port.divergence is not shown:
        yield f"  {port.divergence.text(first, second)}"
    for count in port.fields:
        yield f"  {_field(count)}"


def _parts(port: PortResult, first: str, second: str) -> Iterator[str]:
    total = port.equal + port.within + port.different
    if total == port.equal:
        yield f"{total} messages equal"
    else:
        yield f"{port.different} of {total} messages differ"
        if port.within:
            yield f"{port.within} are within the tolerance"
    if port.missing:
        yield f"{port.missing} only in the {first}"
    if port.added:
        yield f"{port.added} only in the {second}"


def _field(count: FieldCount) -> str:
    text = f"{count.field}: differs in {count.different} messages"
    if count.beyond < count.different:
        text += f", beyond the tolerance in {count.beyond}"
    if count.largest:
        text += f"; largest difference {count.largest:.3g} ({count.at} at step {count.at_step})"
    return text
