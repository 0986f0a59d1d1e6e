"""A participant that code of this process is, step by step, in a run in one process."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.scenario import Scenario
from stepbus_participant import Config, Participant, Queue


@dataclass(frozen=True, kw_only=True)
class Room:
    """What a run gives to a seat.

    queue: makes a queue that gives the others their turns. ask_end: ends the run before a step.
    leave, enter: take away, and put in place again, what participants find around them; `enter`
    gets how long nobody worked [s].
    """

    queue: Callable[[], Queue]
    ask_end: Callable[[int, str], None]
    leave: Callable[[], None]
    enter: Callable[[float], None]


class Seat(Protocol):
    """A participant that is no program.

    name: of the participant.
    """

    @property
    def name(self) -> str:
        """Return which participant it is."""

    def make(self, config: Config) -> Participant:
        """Return what takes part."""

    def sit(self, room: Room) -> None:
        """Take what the run gives, before its first step."""

    def away(self) -> bool:
        """Let our caller work; called where nobody else can, returns whether somebody can now."""


class HostedCaller(RunExtension):
    """Lets a seat take part; it ends the run."""

    is_hosting = True

    def __init__(self, seat: Seat) -> None:
        self.seat = seat

    def adapt(self, scenario: Scenario) -> Scenario:
        """Return the scenario without an end: the seat sees the outcome of the last step."""
        return dataclasses.replace(scenario, steps=None)
