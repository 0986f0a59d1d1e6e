"""Starts and ends the processes of a run, and lets others start some."""

import contextlib
import resource
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from msgspec.structs import asdict

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes import reaper
from stepbus_orchestrator.processes.attached import Attached, JoinTicket, publish
from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.endpoints import private_folder
from stepbus_orchestrator.processes.ticket_line import line_of
from stepbus_orchestrator.processes.warm import participant_environment
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import Endpoint, Ticket
from stepbus_schemas import SPOKEN

_END_S = 10.0
"""How long the reaper may take to remove the private folder; it may have been stopped [s]."""
_OWN_FILES = 29
"""Open files of an orchestrator without participants; each of these adds a link."""


def check_limits(participants: int) -> None:
    """Raise StartFailed when the limit of open files is too low for so many participants.

    Somewhere in the midst of a start, the system would fail with `Too many open files`.
    """
    needed = _OWN_FILES + participants
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if allowed not in {resource.RLIM_INFINITY, -1} and allowed < needed:
        raise StartFailed(
            f"a run of {participants} participant{'s' * (participants > 1)} needs "
            f"{needed} open files, but this shell allows {allowed}; raise the limit with "
            f"`ulimit -n {max(256, 2 * needed)}`"
        )


class Launcher:
    """Owns every process of one run, and its private folder, for sockets and tickets.

    A process of its own, the reaper, kills what is left of the run and removes the folder, also
    should the orchestrator be killed.

    logs: folder of the participants' logs; default: the private one. folder: the private one.
    children: those that were started, by name. Raises BusFailed where the folder cannot be made,
    StartFailed, without leaving it behind, when no process can be started.
    """

    def __init__(self, *, run: str, token: str, logs: Path | None = None) -> None:
        self.folder = private_folder()
        self.children: dict[str, Child] = {}
        self._run = run
        self._token = token
        self._logs = logs or self.folder
        self._others: list[Path] = []
        try:
            self._reaper = subprocess.Popen(
                [sys.executable, "-I", "-S", reaper.__file__, str(self.folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        except OSError as exc:
            # It is empty. To remove it takes no file descriptor, of which there may be none left.
            self.folder.rmdir()
            raise StartFailed(
                "cannot start the reaper, which cleans up after a run: "
                f"{exc.strerror}; check ulimit -n and ulimit -u"
            ) from exc

    def start(
        self,
        spec: ParticipantSpec,
        command: Sequence[str],
        endpoint: Endpoint,
        scenario_folder: Path,
        *,
        has_terminal: bool = False,
        **fields: Any,
    ) -> Child:
        """Start one participant.

        has_terminal: it gets our terminal, to be debugged. fields: further ones of its ticket.

        Raises StartFailed when its ticket cannot be written, or its program not executed.
        """
        path = self.folder / f"{spec.name}.ticket"
        publish(self._ticket(spec, endpoint, fields), path)
        child = Child(
            spec.name,
            command,
            cwd=scenario_folder,
            log=self._logs / f"{spec.name}.log",
            environment=participant_environment(str(path)),
            has_terminal=has_terminal,
        )
        self._tell_reaper(f"+{child.pid}")
        self.children[spec.name] = child
        return child

    def admit(
        self,
        spec: ParticipantSpec,
        endpoint: Endpoint,
        scenario_folder: Path | None,
        *,
        ticket: Path | None,
        files: Mapping[str, str] = MappingProxyType({}),
        **fields: Any,
    ) -> Attached:
        """Put the ticket of one participant where the user picks it up.

        scenario_folder: None where it is on another host. ticket: the path; None: the user gets it
        as a line. files: as of `JoinTicket`. fields: further ones. Raises StartFailed when it
        cannot be written there.
        """
        content = JoinTicket(
            files=dict(files),
            **asdict(self._ticket(spec, endpoint, fields)),
            exec=spec.exec or spec.program,
            folder="" if scenario_folder is None else str(scenario_folder.absolute()),
            bridge="" if spec.bridge is None else spec.bridge.format,
            describe={} if spec.bridge is None else spec.bridge.describe,
        )
        path = (ticket or self.folder / f"{spec.name}.ticket").absolute()
        if ticket is not None:
            publish(content, path)
            self.remove_too(path)
        # The first that a participant connects to is the orchestrator.
        attached = Attached(
            path, self._logs / f"{spec.name}.log", endpoint.connect[0], self.children.values()
        )
        attached.line = "" if ticket else line_of(content)
        attached.is_distant = scenario_folder is None
        return attached

    def remove_too(self, path: Path) -> None:
        """Have a file, or another folder, removed with the private one."""
        self._others.append(path)
        self._tell_reaper(str(path))

    @contextlib.contextmanager
    def guarded(self, pid: int) -> Iterator[None]:
        """Have a further process of ours, which leads its group, ended with the run."""
        self._tell_reaper(f"+{pid}")
        yield
        self._tell_reaper(f"-{pid}")

    def _tell_reaper(self, line: str) -> None:
        with contextlib.suppress(BrokenPipeError):
            print(line, file=self._reaper.stdin, flush=True)

    def _ticket(self, spec: ParticipantSpec, endpoint: Endpoint, fields: dict[str, Any]) -> Ticket:
        return Ticket(
            run=self._run,
            name=spec.name,
            token=self._token,
            endpoint=endpoint,
            join_timeout_s=spec.deadlines.join_s,
            **{"protocols": SPOKEN, **fields},
        )

    def end_all(self) -> list[tuple[str, str]]:
        """End every process that is left, and the reaper; remove the private folder.

        Return (participant, warning) of each process that the reaper had to end.
        """
        for child in self.children.values():
            child.end()
            self._tell_reaper(f"-{child.pid}")
        try:
            said, _ = self._reaper.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            self._reaper.kill()
            said, _ = self._reaper.communicate()  # no time-out: it was killed
        # It may have been killed, or stopped, by another process.
        for path in (self.folder, *self._others):
            reaper.remove(str(path))
        left = (line.split(" ", 2) for line in said.splitlines())
        text = "left a process behind, which was killed"
        return [(name, f"{text}: {command} (pid {pid})") for name, pid, command in left]
