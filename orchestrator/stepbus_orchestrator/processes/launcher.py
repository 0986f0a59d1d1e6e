"""The environment of Python participants, in a process of their own or in a shared one."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from msgspec.structs import asdict

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.external import External
from stepbus_orchestrator.processes.port_users import cut_links
from stepbus_orchestrator.processes.reaping import LeftBehind, Reaper
from stepbus_orchestrator.processes.shared_ticket import JoinTicket, SharedTicket
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import (
    NO_CHECKPOINTS,
    ONE_THREAD,
    TICKET_VARIABLE,
    CheckpointOrder,
    Endpoint,
    MessageFault,
    ProfileOrder,
    Ticket,
)

PYTHON = {
    # One thread for each BLAS: more only compete for the cores the lockstep runs on.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONUNBUFFERED": "1",
    # The order of a set of texts is the same in every run.
    "PYTHONHASHSEED": "0",
}


def is_set() -> bool:
    """Return whether this process has it, so that it can host participants as their own would."""
    return all(os.environ.get(name) == value for name, value in PYTHON.items())


class Launcher:
    """Owns every process of one run, and its private folder.

    folder: the private folder, removed at the end. logs: folder of the participants' logs. Raises
    StartFailed, without leaving the folder behind, when no process can be started.
    """

    def __init__(self, *, run: str, token: str, folder: Path, logs: Path) -> None:
        self._run = run
        self._token = token
        self._folder = folder
        self._logs = logs
        self.children: dict[str, Child] = {}
        self._shared: list[SharedTicket] = []
        self._reaper = Reaper(folder)

    def start(
        self,
        spec: ParticipantSpec,
        command: Sequence[str],
        endpoint: Endpoint,
        scenario_folder: Path,
        *,
        faults: Sequence[MessageFault] = (),
        has_terminal: bool = False,
        profile: ProfileOrder | None = None,
        checkpoint: CheckpointOrder = NO_CHECKPOINTS,
    ) -> Child:
        """Start one participant.

        faults: on its messages. has_terminal: it gets our terminal, to be debugged.
        profile: what to measure of its steps. checkpoint: when to save its state, and from which to
        start.

        Raises StartFailed when its program cannot be executed.
        """
        ticket = self._ticket(spec, endpoint, faults, profile, checkpoint)
        path = self._folder / f"{spec.name}.ticket"
        try:
            ticket.save(path)
        except OSError as exc:
            raise StartFailed(
                f"{spec.name}: its ticket {path} cannot be written: {exc.strerror}; "
                "set TMPDIR to a folder with room",
                participant=spec.name,
            ) from exc
        child = Child(
            spec.name,
            command,
            cwd=scenario_folder,
            log=self._logs / f"{spec.name}.log",
            environment=participant_environment(path),
            has_terminal=has_terminal,
        )
        self._reaper.watch(child.pid)
        self.children[spec.name] = child
        return child

    def admit(
        self,
        spec: ParticipantSpec,
        endpoint: Endpoint,
        scenario_folder: Path,
        *,
        ticket: Path,
        faults: Sequence[MessageFault] = (),
        profile: ProfileOrder | None = None,
        checkpoint: CheckpointOrder = NO_CHECKPOINTS,
    ) -> External:
        """Put the ticket of one participant where somebody else picks it up.

        ticket: the path. faults, profile, checkpoint: as of `start`. Raises StartFailed when it
        cannot be written there.
        """
        content = JoinTicket(
            **asdict(self._ticket(spec, endpoint, faults, profile, checkpoint)),
            exec=list(spec.program),
            folder=str(scenario_folder.absolute()),
            bridge="" if spec.bridge is None else spec.bridge.format,
            describe={} if spec.bridge is None else spec.bridge.describe,
        )
        shared = SharedTicket(content, ticket)
        self._shared.append(shared)
        # The first that a participant connects to is the orchestrator.
        return External(
            shared,
            self._logs / f"{spec.name}.log",
            lambda pid: cut_links(endpoint.connect[0], pid, self._pids()),
        )

    def _ticket(
        self,
        spec: ParticipantSpec,
        endpoint: Endpoint,
        faults: Sequence[MessageFault],
        profile: ProfileOrder | None,
        checkpoint: CheckpointOrder,
    ) -> Ticket:
        return Ticket(
            run=self._run,
            name=spec.name,
            token=self._token,
            endpoint=endpoint,
            join_timeout_s=spec.deadlines.join_s,
            faults=list(faults),
            profile=profile,
            checkpoint=checkpoint,
        )

    def _pids(self) -> list[int]:
        return [child.pid for child in self.children.values()]

    def end_all(self) -> list[LeftBehind]:
        """End every process that is left, and the reaper, which removes the private folder.

        Return what participants have left behind in sessions of their own.
        """
        for shared in self._shared:
            shared.close()
        for child in self.children.values():
            child.end()
            self._reaper.forget(child.pid)
        return self._reaper.end()


def participant_environment(ticket: Path) -> Mapping[str, str]:
    """Return the environment of a participant: ours, the ticket, and unbuffered prints."""
    return {**ONE_THREAD, **os.environ, **PYTHON, TICKET_VARIABLE: str(ticket)}
