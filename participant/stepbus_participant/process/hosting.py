"""A participant without a process of its own: what its `main` needs to know."""

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from stepbus_participant.bus import Bus
from stepbus_participant.bus.ticket import Ticket


@dataclass(frozen=True)
class Host:
    """The place of one participant in a process that it shares with others.

    ticket: its identity. bus: what it takes instead of a connection to the ticket's endpoint. log:
    where it prints, and where a program that it starts has to. started: takes the process id, and
    group, of such a program, so that it can be ended.
    """

    ticket: Ticket
    bus: Bus
    log: Path | None = None
    started: Callable[[int], None] = lambda _pid: None


HOST: ContextVar[Host | None] = ContextVar("HOST", default=None)
"""Set by `stepbus run --in-process` where the program of a participant runs."""
