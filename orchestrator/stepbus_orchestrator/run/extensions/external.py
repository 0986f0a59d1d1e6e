"""Participants that the user starts elsewhere: how, and which are still missing."""

import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.participants import ParticipantState, Phase
from stepbus_orchestrator.scenario.fault_texts import PROCESS_FAULTS, faults_of, format_fault
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_schemas import WiringError

from .debug import check_names

_TOLD = Path("-")
_REMIND_S = 5.0
_NO_END_S = 1e5
"""Deadlines that are longer are none."""


class External(RunExtension):
    """Waits for participants with `start: external`; tells how to start them, and which it misses.

    Of all participants, it tells which have not ended.

    tickets: where the tickets of some are put, which are external from then on; default:
    `<name>.ticket` in the run's folder; `-`: it tells them as a line.
    """

    def __init__(self, tickets: Mapping[str, Path] = MappingProxyType({})) -> None:
        self._tickets = tickets
        self._told_at = 0.0

    def prepare(self, scenario: Scenario) -> Scenario:
        """Return a scenario in which the user starts the participants that have a ticket, too.

        Raises WiringError for what cannot be done to a participant that is started elsewhere.
        """
        check_names(scenario, self._tickets)
        scenario = scenario.changed(self._tickets, start="external")
        names = external_names(scenario)
        faults = [
            format_fault(fault)
            for fault in faults_of(scenario.faults, PROCESS_FAULTS)
            if fault.participant in names
        ]
        if faults:
            raise WiringError(
                f"{', '.join(faults)}: stepbus cannot signal a process that it did not "
                "start; message faults work for external participants too"
            )
        return scenario

    def attach(self, run: RunView) -> None:
        """Remind the user from now on."""
        super().attach(run)
        self._told_at = self.run.clock.monotonic()

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return where the ticket of a participant is put."""
        if not spec.is_external:
            return {}
        path = self._tickets.get(spec.name, self.run.out / f"{spec.name}.ticket")
        return {"ticket": None if path == _TOLD else path}

    def started(self, participant: ParticipantState) -> None:
        """Tell the command that starts a participant."""
        external = participant.external
        if external is None:
            return
        how = f"start it with `{external.command}`"
        if external.is_distant:
            copied = "" if external.line else f"{external.ticket} and "
            how = (
                f"copy {copied}the folder {self.run.state.scenario.folder} to its host, and start "
                f"it there, in that folder, with `{external.command}`"
            )
        own = shlex.join(participant.spec.program)
        text = f"{how}, which runs `{own}`; append `-- PROGRAM` to run another program"
        if external.line:
            # A line of its own: it is selected by one click.
            text += f"; LINE is for this run only, and a secret:\n{external.line}"
        self._tell(participant, text)

    def awaiting(self, participants: Iterable[ParticipantState]) -> None:
        """Tell from time to time which have not come yet, or not left."""
        now = self.run.clock.monotonic()
        if now - self._told_at < _REMIND_S:
            return
        self._told_at = now
        for participant in participants:
            if self.run.state.phase.is_stopping:
                may_stand = "; is it in a debugger?" if participant.external is not None else ""
                self._tell(participant, f"has not ended yet{may_stand}")
            elif participant.external is None:
                continue
            elif participant.phase is Phase.SPAWNED:
                left_s = participant.limit_s("spawn") - participant.in_phase_s
                wait = f"{left_s:.0f} s left" if left_s < _NO_END_S else "no deadline"
                command = participant.external.command
                self._tell(participant, f"has not joined yet ({wait}): {command}")

    def stopping(self) -> None:
        """Give all some time to end before it tells that one has not."""
        self._told_at = self.run.clock.monotonic()

    def _tell(self, participant: ParticipantState, text: str) -> None:
        self.run.observer.event("waiting", participant.name, -1, text)


class StartedHere(RunExtension):
    """Starts all participants here, those with `start: external` too."""

    def prepare(self, scenario: Scenario) -> Scenario:
        """Return a scenario without participants that are external, or on another host."""
        names = [spec.name for spec in scenario.participants if not spec.is_here]
        return scenario.changed(names, start="child", host="")


def external_names(scenario: Scenario) -> list[str]:
    """Return the participants that the user starts."""
    return [spec.name for spec in scenario.participants if spec.is_external]
