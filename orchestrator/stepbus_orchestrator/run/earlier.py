"""Serves participants of earlier protocol numbers: their names of fields, beside those of today.

The kernel speaks the present number only. What it publishes to all participants, or to one, gets
the earlier names too, once one of these has joined; what such a participant sends gets the present
ones. In a run without any, nothing is translated.
"""

from collections.abc import Callable

from stepbus_schemas import (
    PROTOCOL_VERSION,
    Envelope,
    Welcome,
    renamed_fields,
    with_earlier_names,
    with_present_names,
)

Translate = Callable[[bytes], bytes]


class EarlierNumbers:
    """Knows whether participants of earlier protocol numbers take part, and translates for them.

    are_here: whether one has been admitted.
    """

    def __init__(self) -> None:
        self.are_here = False

    def admitted(self, answer: Envelope) -> None:
        """Take note of an answer to a `Hello`."""
        if isinstance(answer, Welcome) and answer.protocol < PROTOCOL_VERSION:
            self.are_here = True

    def outgoing(self, type_name: str) -> Translate | None:
        """Return what adds earlier names to messages of a type; None where it has none."""
        renamed = renamed_fields(type_name)
        return (lambda data: with_earlier_names(data, renamed)) if renamed else None

    def incoming(self, type_name: str, take: Callable[[str, bytes], None]) -> Callable[..., None]:
        """Return a function that takes messages of a type with present names."""
        renamed = renamed_fields(type_name)

        def translated(name: str, data: bytes) -> None:
            take(name, with_present_names(data, renamed) if self.are_here else data)

        return translated
