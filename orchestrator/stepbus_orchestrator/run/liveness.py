"""Which processes of a run have ended before their time, and which one blocks all others."""

import signal
from collections.abc import Callable

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.run.kernel.state import RunState

from .kernel.failures import death, kept_thread, took_nothing
from .kernel.participants import ParticipantState

LAST_REPORTS_S = 0.1
"""Those who wait for a process that has died report after 20 ms at which step (P9.2, P9.3)."""


class Liveness:
    """Looks at the processes of a run.

    receive_for: takes what arrives within a time [s], and raises the first failure reported.
    """

    def __init__(self, state: RunState, receive_for: Callable[[float], None]) -> None:
        self._state = state
        self._receive_for = receive_for
        self._killed: list[str] = []

    def check(self) -> None:
        """Raise for a process that has ended before the run (P10.4)."""
        if self._state.phase.is_stopping:
            return
        for name, participant in self._state.participants.items():
            if participant.process.exit_code() is not None and name != self._state.replaced:
                raise self._death(participant)

    def _death(self, participant: ParticipantState) -> RunFailure:
        state = self._state
        details = (participant, state.participants, state.barrier, state.scenario.step_ns)
        if participant.name in self._killed:
            return took_nothing(*details)
        if participant.process.late is not None:
            return kept_thread(participant, participant.process.late, *details[1:])
        # A fault that it, or a witness, has reported is more precise, and is raised from here.
        self._receive_for(LAST_REPORTS_S)
        return death(*details)

    def kill_blockers(self) -> None:
        """Kill a process that reads nothing while a message to it blocks everything else.

        Called on the watchdog's thread, and again while that frees nothing: then it is another.
        """
        participants = {
            name: participant
            for name, participant in self._state.participants.items()
            if participant.process.exit_code() is None
        }
        stopped = [
            name
            for name, participant in participants.items()
            if participant.process.activity().is_stopped
        ]
        holders = [name for name in self._state.barrier.holders() if name in participants]
        for name in stopped or holders or participants:
            self._killed.append(name)
            participants[name].process.signal(signal.SIGKILL)
