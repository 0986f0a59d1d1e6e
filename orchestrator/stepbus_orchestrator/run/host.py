"""The seams of a run: its host has a clock, a bus and a disk, and starts the participants.

`hosts.Processes` starts a process for each participant, `hosts.InProcess` has them all in this one.
"""

import threading
from contextlib import AbstractContextManager
from typing import Protocol

from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import Bus, Clock, Disk

from .extension import RunView, Strategy


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
