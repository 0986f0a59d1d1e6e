"""Who takes part in a run, and how far each of them has come."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_schemas import Ready, Waiting

if TYPE_CHECKING:
    from stepbus_orchestrator.processes.activity import Activity
    from stepbus_orchestrator.processes.external import External


@dataclass(frozen=True)
class KeptThread:
    """How a participant that shares our thread missed a deadline.

    held_s: how long it kept the thread [s]. where: the line of its code; empty while it waits for
    a program of its own. is_stopped: whether a signal or a debugger has stopped that.
    """

    held_s: float
    where: str
    is_stopped: bool = False


class Process(Protocol):
    """A participant's process, as a run sees it; `processes.child.Child` is the real one."""

    @property
    def pid(self) -> int:
        """Return its process id."""

    @property
    def log(self) -> Path:
        """Return the file its stdout and stderr go to."""

    @property
    def late(self) -> KeptThread | None:
        """Return how it missed a deadline, where it shares our thread and has."""

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs."""

    def how_it_ended(self) -> str:
        """Return its end in words."""

    def last_error(self) -> str:
        """Return the last error it printed, or its last line, or nothing."""

    def log_problem(self) -> str:
        """Return why its log may lack its last words, such as a full disk."""

    def limit_log(self) -> None:
        """Keep the head and the tail of its log, once that has become large."""

    def activity(self) -> "Activity":
        """Return what it, and all it has started, is doing."""

    def signal(self, number: int) -> None:
        """Send it a signal."""

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""

    def terminate(self) -> None:
        """Ask it to end, and all it has started."""

    def end(self, grace_s: float = ...) -> None:
        """Terminate it, then kill it and all it has started. grace_s: between the two."""


class Phase(IntEnum):
    """How far a participant has come (P4)."""

    SPAWNED = 0
    ALIVE = 1
    JOINED = 2
    READY = 3


PHASE_DEADLINES = {Phase.SPAWNED: "spawn", Phase.ALIVE: "join", Phase.JOINED: "ready"}


def _unknown() -> int:
    return -1


@dataclass
class ParticipantState:
    """How far one participant is, as the orchestrator sees it.

    in_phase_s, holds_s: how long it has been in its phase, and held the step [s]. ended_s: how long
    its process has ended while closing outputs are awaited [s]. waiting: what
    it waited for when it last sent its log. missed_trigger: whether that was a trigger
    that had been sent already. newest: returns the newest step it was seen to
    publish, with an observer; −1 elsewhere. external: its process, where somebody else starts it.
    takes_batches: whether its program takes a `Batch` from its sources (P7.6).
    has_left: whether it has left the bus; all that it published has arrived before.
    """

    spec: ParticipantSpec
    process: Process
    newest: Callable[[], int] = _unknown
    phase: Phase = Phase.SPAWNED
    in_phase_s: float = 0.0
    holds_s: float = 0.0
    held_step: int = -1
    ended_s: float = 0.0
    waiting: Waiting | None = None
    missed_trigger: bool = False
    ready: Ready | None = None
    language: str = ""
    takes_batches: bool = False
    drops: Mapping[str, int] = field(default_factory=dict)
    external: "External | None" = None
    has_left: bool = False

    @property
    def name(self) -> str:
        """Return its name."""
        return self.spec.name

    def advance(self, phase: Phase) -> bool:
        """Enter a phase; return whether it is a later one."""
        if phase <= self.phase:
            return False
        self.phase, self.in_phase_s = phase, 0.0
        return True

    def hold(self, step: int, elapsed_s: float) -> None:
        """Count some more time [s] in which it has held a step."""
        self.holds_s = elapsed_s + (self.holds_s if self.held_step == step else 0.0)
        self.held_step = step

    def who(self) -> str:
        """Return its name and process id, as error messages give them."""
        if self.external is None:
            return f"{self.name} (pid {self.process.pid})"
        pid = f", pid {self.external.pid}" if self.external.pid else ""
        return f"{self.name} (external{pid})"

    def where_it_prints(self) -> str:
        """Return where its output is, as error messages give it."""
        if self.external is None:
            return f"its log: {self.process.log}"
        return "its output is where it was started"

    def local(self) -> tuple[str, str]:
        """Return what of `who` and of `where_it_prints` only this machine knows."""
        return self.who().removeprefix(self.name), f"; {self.where_it_prints()}"


Participants = Mapping[str, ParticipantState]
