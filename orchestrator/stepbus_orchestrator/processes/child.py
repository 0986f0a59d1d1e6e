"""One participant's process, owned from its start to its end."""

import contextlib
import errno
import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed, StartFailed
from stepbus_participant import append_to, last_error

from .activity import Activity, activity
from .bounded_log import BoundedLog

TERM_GRACE_S = 1.0
"""How long a process may take to end after SIGTERM [s]."""
_KILL_S = 5.0
"""How long a killed process may take to go; one in the middle of a disk access takes long [s]."""
_FIRST_PAUSE_S = 0.0005
_LONGEST_PAUSE_S = 0.05


class Child:
    """A process in a session of its own, so that Ctrl-C in the terminal does not reach it.

    name: the participant. log: where its stdout and stderr go. has_terminal: they go where ours
    go instead, and its stdin is ours. pid: its process id and group.
    """

    late = None
    """It has a thread of its own."""

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
        self.name = name
        self.log = log
        self._bounded_log = BoundedLog(log)
        self._lock = threading.Lock()
        try:
            with os.fdopen(append_to(log), "ab") as file:
                if has_terminal:
                    file.write(b"its output went to the terminal (--debug)\n")
                self._process = subprocess.Popen(
                    command,
                    cwd=cwd,
                    env=environment,
                    stdin=None if has_terminal else subprocess.DEVNULL,
                    stdout=None if has_terminal else file,
                    stderr=None if has_terminal else subprocess.STDOUT,
                    start_new_session=True,
                )
        except OSError as exc:
            if not log.parent.is_dir():
                raise RecordingFailed(
                    f"{log.parent} is gone: somebody changed the run's folder while it started; "
                    "run again, and leave it alone until it ends"
                ) from exc
            if not cwd.is_dir():
                raise StartFailed(f"{cwd} is gone, in which {name} starts") from exc
            is_script = exc.errno == errno.ENOEXEC
            hint = "; a script begins with #! and its interpreter" if is_script else ""
            raise StartFailed(
                f"{name} could not be started: {' '.join(command)}: {exc.strerror or exc}{hint} "
                f"(participants.{name}.exec)",
                participant=name,
            ) from exc
        self.pid = self._process.pid
        self._is_terminated = False

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs.

        The process is not reaped before `end`: as long as it is a zombie, its process group is
        its own, and no signal to the group can reach another process.
        """
        with self._lock:
            if self._process.returncode is not None:
                return self._process.returncode
            ended = os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if ended is None:
            return None
        return ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        deadline, pause_s = time.monotonic() + timeout_s, _FIRST_PAUSE_S
        while self.exit_code() is None:
            self.limit_log()
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
        with self._lock, contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_KILL_S)
        self.limit_log()

    def limit_log(self) -> None:
        """Keep the head and the tail of its log, once that has become large."""
        self._bounded_log.limit()

    def signal(self, number: int) -> None:
        """Send a signal to it and all it has started; nothing once it has been reaped."""
        with self._lock, contextlib.suppress(ProcessLookupError, PermissionError):
            if self._process.returncode is None:
                os.killpg(self.pid, number)

    def activity(self) -> Activity:
        """Return what it, and all it has started, is doing."""
        return activity(self.pid)

    def how_it_ended(self) -> str:
        """Return its end in words: `exited with code 1` or `was killed by SIGKILL`."""
        code = self.exit_code()
        if code is not None and code < 0:
            return f"was killed by {signal.Signals(-code).name}"
        return f"exited with code {code}"

    def last_error(self) -> str:
        """Return the last error it printed, or its last line, or nothing."""
        return last_error(self.log)

    def log_problem(self) -> str:
        """Return why its log may lack its last words, such as a full disk; empty: it has them."""
        return self._bounded_log.problem()
