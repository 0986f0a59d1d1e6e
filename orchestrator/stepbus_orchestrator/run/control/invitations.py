"""Participants that somebody else starts: how to start them, and who is still missing."""

import shlex
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from stepbus_orchestrator.run.kernel.participants import ParticipantState, Phase
from stepbus_orchestrator.run.reports.progress import Observer
from stepbus_participant import write_file

_REMIND_S = 5.0
_NO_END_S = 1e5
"""Deadlines that are longer are none."""
_SCRIPT = """#!/bin/sh
# Starts {name} in the run of this folder; another program follows `--`.
exec {command} "$@"
"""


class Invitations:
    """Tells who is still missing, and how to start them.

    out: folder of the run, which gets a script for each.
    """

    def __init__(self, out: Path, observer: Observer) -> None:
        self._out = out
        self._observer = observer
        self._scripts: list[Path] = []
        self._told_at = time.monotonic()

    def add(self, participant: ParticipantState) -> None:
        """Write and tell the command that starts a participant."""
        if participant.external is None:
            return
        arguments = ["join", str(participant.external.ticket.path)]
        command = shlex.join([sys.executable, "-P", "-m", "stepbus_orchestrator.cli", *arguments])
        script = self._out / f"join-{participant.name}.sh"
        text = _SCRIPT.format(name=participant.name, command=command)
        write_file(script, text.encode(), 0o700)
        self._scripts.append(script)
        own = shlex.join(participant.spec.exec)
        self._tell(
            participant,
            f"start it elsewhere with `{shlex.join(['stepbus', *arguments])}`, which runs "
            f"`{own}`, or another program with `-- PROGRAM` behind it; also {script}",
        )

    def remind(self, participants: Iterable[ParticipantState]) -> None:
        """Tell from time to time who is not there yet, and how long the run still waits."""
        if not self._is_time():
            return
        for participant in participants:
            if participant.external is not None and participant.phase is Phase.SPAWNED:
                left_s = participant.spec.deadlines.spawn_s - participant.in_phase_s
                wait = f"{left_s:.0f} s left" if left_s < _NO_END_S else "no deadline"
                path = participant.external.ticket.path
                self._tell(participant, f"is not there yet ({wait}): stepbus join {path}")

    def remind_to_leave(self, participants: Iterable[ParticipantState]) -> None:
        """Tell from time to time who has not left the bus though the run is over."""
        if not self._is_time():
            return
        for participant in participants:
            if participant.external is not None:
                self._tell(participant, "has not ended yet; is it in a debugger?")

    def _is_time(self) -> bool:
        now = time.monotonic()
        if now - self._told_at < _REMIND_S:
            return False
        self._told_at = now
        return True

    def close(self) -> None:
        """Remove the scripts."""
        for script in self._scripts:
            script.unlink(missing_ok=True)

    def _tell(self, participant: ParticipantState, text: str) -> None:
        self._observer.event("waiting", participant.name, -1, text)
