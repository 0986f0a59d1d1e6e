"""The seams of a run: its host has a clock, a bus and a disk, and starts the participants.

`hosts.Processes` starts a process for each participant, `hosts.InProcess` has them all in this one.
"""

import threading
from contextlib import AbstractContextManager
from typing import Any, Protocol

from stepbus_orchestrator.processes.slots import RunSlots
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import Bus, Clock, Config, Disk, Participant

from .extension import RunView


class Strategy:
    """How a run gets its participants.

    has_links: whether messages between them travel over a transport. slots: what they share files
    by.
    """

    has_links = False
    slots: RunSlots = RunSlots()

    def launch(self, run: RunView) -> None:
        """Start them, and hand each to `run.started`.

        Raises StartFailed when one cannot be started.
        """
        raise NotImplementedError


class Caller(Protocol):
    """Our caller, who makes the steps of a run in one process, in place of a participant.

    name: of the participant. local: the run, once it is open.
    """

    name: str
    local: Any

    def make(self, config: Config) -> Participant:
        """Return the participant."""

    def away(self) -> bool:
        """Work where no participant can; return whether one can now."""


class Host(Protocol):
    """Where a run takes place."""

    @property
    def clock(self) -> Clock:
        """Return the time by which the run, and its buses, go."""

    @property
    def disk(self) -> Disk:
        """Return what writes the files of the run."""

    def alone(self, interrupt: threading.Event) -> AbstractContextManager[None]:
        """Wait until no other run disturbs this one, and keep it so; raises Interrupted."""

    def check(self, scenario: Scenario) -> None:
        """Raise WiringError for a scenario that cannot run here, with every reason."""

    def open(self, run: RunView) -> AbstractContextManager[tuple[Bus, Strategy]]:
        """Open the bus of a run, and return how it gets its participants; end them all."""
