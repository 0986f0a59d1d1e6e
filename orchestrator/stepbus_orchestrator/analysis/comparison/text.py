"""A comparison in lines for people."""

from collections.abc import Iterator

from .divergence import Divergence, FieldCount, PortResult


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
