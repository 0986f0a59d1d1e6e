"""The ports of a participant in a scenario: where an input comes from, what an output carries."""

import re
from collections.abc import Iterator
from functools import cached_property

from stepbus_participant import Settings, Whole, suggest
from stepbus_participant.parameters import Keys
from stepbus_schemas import Event, type_name

RECORD_ALL, RECORD_OFF, _EVERY = "all", "off", "every "
_RECORD = re.compile(f"{RECORD_ALL}|{RECORD_OFF}|{_EVERY}[1-9][0-9]{{0,8}}")


class InputSpec(Settings, dict=True, omit_defaults=True):
    """Where an input comes from."""

    short = "from"

    from_: str
    """`participant.output`; not an output of the participant itself."""
    delay: Whole = 0
    """Minimum age of the message [steps]."""
    type: str | None = None
    """Message type that this participant requires; it is checked against the output's."""

    @cached_property
    def source(self) -> str:
        """Return the participant that publishes it."""
        return self.from_.partition(".")[0]

    @cached_property
    def port(self) -> str:
        """Return the output of that."""
        return self.from_.partition(".")[2]

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what cannot be an output."""
        if not (self.source and self.port) or "." in self.port:
            text = f"must be PARTICIPANT.OUTPUT, e.g. plant.joint_state, not {self.from_!r}"
            yield ("from",), text


class OutputSpec(Settings, omit_defaults=True):
    """What an output carries."""

    short = "type"

    type: str
    """`Name/major`, one of [messages.md](messages.md) or of the scenario's `types`."""
    bulk: bool = False
    """Whether the content is large, and travels on a separate key."""
    record: str = RECORD_ALL
    """What is recorded: `all`, `every 10` (the first of every ten steps of the participant),
    or `off`."""

    @property
    def record_every(self) -> int:
        """Return of how many steps of its participant the first is recorded; 0: none."""
        if self.record == RECORD_ALL:
            return 1
        return 0 if self.record == RECORD_OFF else int(self.record.removeprefix(_EVERY))

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what cannot be recorded like that."""
        if not _RECORD.fullmatch(self.record):
            near = suggest(self.record, (RECORD_ALL, RECORD_OFF, f"{_EVERY}10"))
            text = f"must be all, off or every N, e.g. every 10, not {self.record!r}"
            yield ("record",), text + near
        elif self.record != RECORD_ALL and self.type == type_name(Event):
            text = (
                f"an output of {self.type} must be recorded completely: views and reports "
                "show its events"
            )
            yield ("record",), text
