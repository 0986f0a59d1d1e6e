"""The process of a participant: what a run asks of it, its log, and a child of ours."""

import contextlib
import errno
import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.activity import Activity, activity
from stepbus_orchestrator.processes.warm import fork
from stepbus_participant import append_to, last_lines

TERM_GRACE_S = 1.0
"""How long a process may take to end after SIGTERM [s]."""
_KILL_S = 5.0
"""How long a killed process may take to go; one in the middle of a disk access takes long [s]."""
_FIRST_PAUSE_S = 0.0005
_LONGEST_PAUSE_S = 0.05


class Process:
    """A participant's process, as a run sees it.

    log: the file of its stdout and stderr. pid: its process id; 0: unknown. late: how it missed
    a deadline, where it shares our thread and has: `computing for 3.1 s, at a.py:7 in update`.
    """

    def __init__(self, log: Path) -> None:
        self.log = log
        self.pid = 0
        self.late = ""

    def where(self) -> str:
        """Return its process id in words, and its host if that is another one."""
        return f"pid {self.pid}"

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs."""
        raise NotImplementedError

    def how_it_ended(self) -> str:
        """Return a phrase for its end: `exited with code 1` or `was killed by SIGKILL`."""
        code = self.exit_code()
        if code is not None and code < 0:
            return f"was killed by {signal.Signals(-code).name}"
        return f"exited with code {code}"

    def last_output(self) -> str:
        """Return the last lines that it printed; empty: none."""
        return last_lines(self.log)

    def activity(self) -> Activity:
        """Return what it, and all it has started, is doing."""
        raise NotImplementedError

    def silence(self) -> str:
        """Return that its host is out of reach, and since when; empty: it is not."""
        return ""

    def signal(self, number: int) -> None:
        """Send it a signal, and all it has started."""

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        raise NotImplementedError

    def terminate(self) -> None:
        """Ask it once to end, and all it has started."""

    def end(self, grace_s: float = TERM_GRACE_S) -> None:
        """Terminate it, then kill it and all it has started. grace_s: between the two."""


class Child(Process):
    """A process in a session of its own, so that Ctrl-C in the terminal does not reach it.

    name: the participant. log: the file of its stdout and stderr. has_terminal: it shares our
    terminal instead, to be debugged. pid: its process id and group.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        *,
        cwd: Path,
        log: Path,
        environment: Mapping[str, str],
        has_terminal: bool = False,
    ) -> None:
        super().__init__(log)
        self.name = name
        self._lock = threading.Lock()
        self._code: int | None = None
        self._is_terminated = False
        try:
            with os.fdopen(append_to(log), "ab") as file:
                if has_terminal:
                    file.write(b"its output went to the terminal (--debug)\n")
                forked = None if has_terminal else fork(command, cwd, environment, file.fileno())
                self.pid = forked or _started(
                    command, cwd, environment, None if has_terminal else file
                )
        except OSError as exc:
            is_script = exc.errno == errno.ENOEXEC
            hint = "; a script needs a first line with #! and its interpreter" if is_script else ""
            raise StartFailed(
                f"{name} could not be started: {' '.join(command)}: {exc.strerror or exc}{hint} "
                f"(participants.{name}.exec)",
                participant=name,
            ) from exc

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs.

        The process is not reaped before `end`: as long as it is a zombie, its process group is
        its own, and no signal to the group can reach another process.
        """
        with self._lock:
            if self._code is not None:
                return self._code
            ended = os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if ended is None:
            return None
        return ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        deadline, pause_s = time.monotonic() + timeout_s, _FIRST_PAUSE_S
        while self.exit_code() is None:
            left_s = deadline - time.monotonic()
            if left_s <= 0:
                return False
            time.sleep(min(pause_s, left_s))
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
        return True

    def terminate(self) -> None:
        """Ask it once to end, and all it has started: a second SIGTERM would disturb its close."""
        if self.exit_code() is None and not self._is_terminated:
            self._is_terminated = True
            self.signal(signal.SIGTERM)
            # A frozen process takes no SIGTERM until it continues.
            self.signal(signal.SIGCONT)

    def end(self, grace_s: float = TERM_GRACE_S) -> None:
        """Terminate it, then kill it and all it has started (P11.4). grace_s: between the two."""
        self.terminate()
        self.wait(grace_s)
        self.signal(signal.SIGKILL)
        if self.wait(_KILL_S):
            code = self.exit_code()
            with self._lock:
                if self._code is None:
                    self._code = code
                    os.waitpid(self.pid, 0)  # no time-out: it has ended

    def signal(self, number: int) -> None:
        """Send a signal to it and all it has started; nothing once it has been reaped."""
        with self._lock, contextlib.suppress(ProcessLookupError, PermissionError):
            if self._code is None:
                os.killpg(self.pid, number)

    def activity(self) -> Activity:
        """Return what it, and all it has started, is doing."""
        return activity(self.pid)


def _started(
    command: Sequence[str], cwd: Path, environment: Mapping[str, str], log: BinaryIO | None
) -> int:
    """Return the process id of a program in a session of its own; None as log: in our terminal."""
    process = subprocess.Popen(
        command,
        cwd=cwd,
        env=environment,
        stdin=None if log is None else subprocess.DEVNULL,
        stdout=log,
        stderr=None if log is None else subprocess.STDOUT,
        start_new_session=True,
    )
    # We reap it: as a zombie, it keeps its process group.
    process.returncode = 0
    return process.pid
