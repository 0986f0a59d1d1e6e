"""Who takes part in a run, and how far each of them has come."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_schemas import Ready, Waiting

if TYPE_CHECKING:
    from stepbus_orchestrator.processes.attached import Attached
    from stepbus_orchestrator.processes.child import Process


class Phase(IntEnum):
    """How far a participant has come (P4)."""

    SPAWNED = 0
    ALIVE = 1
    JOINED = 2
    READY = 3


PHASE_DEADLINES = {Phase.SPAWNED: "spawn", Phase.ALIVE: "join", Phase.JOINED: "ready"}


@dataclass
class ParticipantState:
    """How far one participant is, as the orchestrator sees it.

    in_phase_s, holds_s: how long it has been in its phase, and held the step [s]. ended_s: how long
    its process has ended while closing outputs are awaited [s]. waiting: what it waited for when it
    last sent its log. missed_trigger: whether that was a trigger that had been sent already.
    took_nothing: whether it was killed since it read nothing, and blocked all others.
    newest: returns the newest step it was seen to publish, with an observer; −1 elsewhere.
    external: its process, where the user starts it. takes_batches: whether its program takes a
    `Batch` from its sources (P7.6). has_left: whether it has left the bus; all that it published
    has arrived before.
    """

    spec: ParticipantSpec
    process: "Process"
    newest: Callable[[], int] = lambda: -1
    phase: Phase = Phase.SPAWNED
    in_phase_s: float = 0.0
    holds_s: float = 0.0
    held_step: int = -1
    ended_s: float = 0.0
    waiting: Waiting | None = None
    missed_trigger: bool = False
    took_nothing: bool = False
    ready: Ready | None = None
    language: str = ""
    takes_batches: bool = False
    drops: Mapping[str, int] = field(default_factory=dict)
    external: "Attached | None" = None
    has_left: bool = False

    @property
    def name(self) -> str:
        """Return its name."""
        return self.spec.name

    @property
    def is_on_its_own(self) -> bool:
        """Return whether it is a program that has left the run; the process of a class is ours."""
        return self.has_left and not self.spec.participant

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

    def limit_s(self, phase: str) -> float:
        """Return its deadline for a phase, such as `step` [s]."""
        value: float = getattr(self.spec.deadlines, f"{phase}_s")
        return value

    def limit(self, phase: str) -> str:
        """Return a deadline as error messages give it: `3 s (participants.a.step_timeout)`."""
        return f"{self.limit_s(phase):g} s (participants.{self.name}.{phase}_timeout)"

    def who(self) -> str:
        """Return its name and process id, as error messages give them."""
        if self.external is None:
            return f"{self.name} ({self.process.where()})"
        pid = f", pid {self.external.pid}" if self.external.pid else ""
        return f"{self.name} (external{pid})"

    def where_it_prints(self) -> str:
        """Return where its output is, as error messages give it."""
        if self.external is None:
            return f"its log: {self.process.log}"
        return "its output is in the terminal where it was started"

    def local(self) -> tuple[str, str]:
        """Return what of `who` and of `where_it_prints` only this machine knows."""
        return self.who().removeprefix(self.name), f"; {self.where_it_prints()}"


Participants = Mapping[str, ParticipantState]
