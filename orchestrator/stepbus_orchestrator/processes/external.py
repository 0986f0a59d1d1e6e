"""A participant that somebody else has started, as far as the orchestrator can see it.

It is known by its place on the bus and, where it is a process of this user in our own namespace,
by its process id. It is never sent a signal: who has started it ends it.
"""

import os
from collections.abc import Callable
from pathlib import Path

from stepbus_orchestrator.processes.shared_ticket import SharedTicket

from .activity import Activity, activity_of


class External:
    """Somebody else's process.

    ticket: that it has been given. log: where a child's output would go. cut: cuts the links of a
    process, by its id (0: unknown), so that a put to it no longer blocks. pid: its process id; 0:
    unknown, as in a container.
    """

    late = None
    """It has a thread of its own."""

    def __init__(self, ticket: SharedTicket, log: Path, cut: Callable[[int], None]) -> None:
        self.ticket = ticket
        self.log = log
        self.pid = 0
        self._cut = cut
        self._has_left = False

    def joined(self, pid: int) -> None:
        """Take the process id that it gives itself, if that is a process with our ticket."""
        if self._has_ticket(pid):
            self.pid = pid

    def left(self) -> None:
        """Record that it is no longer on the bus."""
        self._has_left = True

    def exit_code(self) -> int | None:
        """Return 0 once it has left the bus, whatever its exit code; None before."""
        return 0 if self._has_left else None

    def how_it_ended(self) -> str:
        """Return its end in words."""
        return "has left the bus: it has ended, or was killed; its exit code is not ours to see"

    def last_error(self) -> str:
        """Return nothing: it prints where it was started."""
        return ""

    def log_problem(self) -> str:
        """Return nothing: it has no log here."""
        return ""

    def limit_log(self) -> None:
        """Do nothing: it has no log here."""

    def activity(self) -> Activity:
        """Return what it is doing; nothing where nobody knows."""
        return activity_of(self.pid) if self.pid else Activity()

    def signal(self, _number: int) -> None:
        """Cut its links instead: what a signal would have freed is free then."""
        self._cut(self.pid)
        self._has_left = True

    def wait(self, _timeout_s: float) -> bool:
        """Return whether it has left the bus."""
        return self._has_left

    def terminate(self) -> None:
        """Do nothing: the `Stop` has asked it to end."""

    def end(self, _grace_s: float = 0.0) -> None:
        """Cut its links, if it has not left the bus by itself."""
        if not self._has_left:
            self._cut(self.pid)

    def _has_ticket(self, pid: int) -> bool:
        """Return whether a process of this user, which we can see, was started with our ticket."""
        try:
            environment = Path(f"/proc/{pid}/environ").read_bytes()
        except OSError:
            return False
        prefix = b"STEPBUS_TICKET="
        values = [item for item in environment.split(b"\0") if item.startswith(prefix)]
        return any(self.ticket.is_named_by(os.fsdecode(item[len(prefix) :])) for item in values)
