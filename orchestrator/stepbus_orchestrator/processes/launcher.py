"""Starts the participants of a run, and ends them whatever happens."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_participant import ONE_THREAD, TICKET_VARIABLE, Endpoint, MessageFault, Ticket

from .child import Child

_REAPER_S = 2.0
"""How long the reaper may take to remove the private folder; it may have been stopped [s]."""


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
        try:
            self._reaper = _start_reaper(folder)
        except BaseException as exc:
            # It is empty. To remove it takes no file descriptor, of which there may be none left.
            with contextlib.suppress(OSError):
                folder.rmdir()
            if isinstance(exc, OSError):
                raise StartFailed(f"the reaper could not be started: {exc.strerror}") from exc
            raise

    def start(
        self,
        spec: ParticipantSpec,
        command: Sequence[str],
        endpoint: Endpoint,
        scenario_folder: Path,
        *,
        faults: Sequence[MessageFault] = (),
        has_terminal: bool = False,
    ) -> Child:
        """Start one participant.

        faults: on its messages. has_terminal: it gets our terminal, to be debugged.

        Raises StartFailed when its program cannot be executed.
        """
        ticket = Ticket(
            run=self._run,
            name=spec.name,
            token=self._token,
            endpoint=endpoint,
            join_timeout_s=spec.deadlines.join_s,
            faults=list(faults),
        )
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
            environment=_environment(path),
            has_terminal=has_terminal,
        )
        self._notify_reaper(f"+{child.pid}")
        self.children[spec.name] = child
        return child

    def end_all(self) -> None:
        """End every process that is left, and the reaper, which removes the private folder."""
        for child in self.children.values():
            child.end()
            self._notify_reaper(f"-{child.pid}")
        self._end_reaper()

    def _end_reaper(self) -> None:
        if self._reaper.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._reaper.stdin.close()
        try:
            self._reaper.wait(_REAPER_S)
        except subprocess.TimeoutExpired:
            self._reaper.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._reaper.wait(_REAPER_S)
        # It may have been killed, or stopped, by another process.
        shutil.rmtree(self._folder, ignore_errors=True)

    def _notify_reaper(self, line: str) -> None:
        if self._reaper.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._reaper.stdin.write(line + "\n")
                self._reaper.stdin.flush()


def _start_reaper(folder: Path) -> subprocess.Popen[str]:
    program = Path(__file__).with_name("reaper.py")
    return subprocess.Popen(
        [sys.executable, "-I", "-S", str(program), str(folder)],
        stdin=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def _environment(ticket: Path) -> Mapping[str, str]:
    """Return the environment of a participant: ours, the ticket, and unbuffered prints."""
    # One thread for each BLAS: more only compete for the cores the lockstep runs on.
    single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return {
        **ONE_THREAD,
        **os.environ,
        **single,
        "PYTHONUNBUFFERED": "1",
        "PYTHONHASHSEED": "0",
        TICKET_VARIABLE: str(ticket),
    }
