"""Who takes part in a run, and how far each of them has come."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario
from stepbus_schemas import Description, Ready, Waiting


class Phase(IntEnum):
    """How far a participant has come."""

    SPAWNED = 0
    ALIVE = 1
    JOINED = 2
    READY = 3


PHASE_DEADLINES = {Phase.SPAWNED: "spawn", Phase.ALIVE: "join", Phase.JOINED: "ready"}


def _unseen() -> int:
    return -1


@dataclass
class Member:
    """One participant of a run, as the orchestrator sees it.

    in_phase_s, holds_s: how long it has been in its phase, and held the step [s]. waiting: what
    it said it waits for when it last flushed its log. newest: returns the newest step it was seen
    to publish, where somebody looks.
    """

    spec: ParticipantSpec
    child: Child
    newest: Callable[[], int] = _unseen
    phase: Phase = Phase.SPAWNED
    in_phase_s: float = 0.0
    holds_s: float = 0.0
    held_step: int = -1
    waiting: Waiting | None = None
    ready: Ready | None = None
    language: str = ""
    drops: Mapping[str, int] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Return its name."""
        return self.spec.name

    def advance(self, phase: Phase) -> bool:
        """Move on to a phase; return whether that is news."""
        if phase <= self.phase:
            return False
        self.phase, self.in_phase_s = phase, 0.0
        return True

    def hold(self, step: int, elapsed_s: float) -> None:
        """Note that it has held a step for some more time [s]."""
        self.holds_s = elapsed_s + (self.holds_s if self.held_step == step else 0.0)
        self.held_step = step

    def who(self) -> str:
        """Return its name and process id, as error messages give them."""
        return f"{self.name} (pid {self.child.pid})"


Roster = Mapping[str, Member]


def input_descriptions(
    scenario: Scenario, outputs: Descriptions
) -> dict[str, dict[str, Description]]:
    """Return the description of every input: participant → input → description."""
    return {
        spec.name: {
            port: _resolve(scenario, outputs, source.source, source.port, set())
            for port, source in spec.inputs.items()
        }
        for spec in scenario.participants
    }


def _resolve(
    scenario: Scenario,
    outputs: Descriptions,
    name: str,
    port: str,
    seen: set[tuple[str, str]],
) -> Description:
    """Return an output's description, with the names of the input it is `like`."""
    description = outputs.get(name, {}).get(port, Description())
    spec = next(spec for spec in scenario.participants if spec.name == name)
    origin = spec.inputs.get(description.like or "")
    if origin is None or (name, port) in seen:
        return description
    like = _resolve(scenario, outputs, origin.source, origin.port, seen | {(name, port)})
    return Description(
        names=like.names,
        units=description.units,
        limits=description.limits,
        shape=description.shape,
        details=description.details,
    )
