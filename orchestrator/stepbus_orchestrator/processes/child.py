"""The process of a participant: what a run asks of it, its log, and a child of ours."""

import contextlib
import errno
import os
import resource
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.activity import Activity, KeptThread, activity
from stepbus_orchestrator.processes.place import Place, core_of, place_threads
from stepbus_orchestrator.processes.warm import fork
from stepbus_participant import append_to, last_lines

_LARGEST = 8 * 1024 * 1024
_HEAD = _TAIL = 1024 * 1024
_CATCH_UPS = 20
_FULL = (errno.ENOSPC, errno.EDQUOT)
_PROBE = bytes(8192)


class BoundedLog:
    """A log file that a process appends to: past 8 MiB, its first and its last MiB are kept.

    The process must have opened it for appending. What it prints during a cut counts as cut.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._cut = 0
        self._mark = b""

    def limit(self) -> None:
        """Cut the file if it has become too large; harmless when it is gone."""
        with contextlib.suppress(OSError):
            if self._path.stat().st_size > _LARGEST:
                file = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
                try:
                    self._shorten(file)
                finally:
                    os.close(file)

    def problem(self) -> str:
        """Return why nothing more can be printed into the file; empty where it can."""
        try:
            with tempfile.TemporaryFile(dir=self._path.parent, buffering=0) as probe:
                probe.write(_PROBE)
            largest, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
            is_largest = largest not in {resource.RLIM_INFINITY, 0}
            if is_largest and self._path.stat().st_size >= largest:
                return os.strerror(errno.EFBIG)
        except OSError as exc:
            return os.strerror(exc.errno) if exc.errno in _FULL else ""
        return ""

    def _shorten(self, file: int) -> None:
        end = os.fstat(file).st_size
        tail = os.pread(file, _TAIL, end - _TAIL)
        for _ in range(_CATCH_UPS):
            # It may have printed meanwhile, perhaps its last words.
            more = os.pread(file, _TAIL, end)
            tail, end = (tail + more)[-_TAIL:], end + len(more)
            if not more:
                break
        self._cut += end - _HEAD - len(self._mark) - len(tail)
        self._mark = f"\n[stepbus: {self._cut} bytes omitted]\n".encode()
        os.ftruncate(file, _HEAD)
        os.write(file, self._mark + tail)


TERM_GRACE_S = 1.0
"""How long a process may take to end after SIGTERM [s]."""
_KILL_S = 5.0
"""How long a killed process may take to go; one in the middle of a disk access takes long [s]."""
_CAUSES = {
    signal.SIGBUS: " (did another process truncate a file that it maps, such as one of slots?)"
}
_FIRST_PAUSE_S = 0.0005
_LONGEST_PAUSE_S = 0.05


class Process:
    """A participant's process, as a run sees it.

    log: the file its stdout and stderr go to. pid: its process id; 0: unknown. late: how it missed
    a deadline, where it shares our thread and has.
    """

    def __init__(self, log: Path) -> None:
        self.log = log
        self.pid = 0
        self.late: KeptThread | None = None
        self._bounded_log = BoundedLog(log)

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs."""
        raise NotImplementedError

    def how_it_ended(self) -> str:
        """Return its end in words: `exited with code 1` or `was killed by SIGKILL`."""
        code = self.exit_code()
        if code is not None and code < 0:
            number = signal.Signals(-code)
            return f"was killed by {number.name}{_CAUSES.get(number, '')}"
        return f"exited with code {code}"

    def last_output(self) -> str:
        """Return the last lines that it printed; empty: none."""
        return last_lines(self.log)

    def log_problem(self) -> str:
        """Return why its log may lack its last words, such as a full disk; empty: it has them."""
        return self._bounded_log.problem()

    def limit_log(self) -> None:
        """Keep the head and the tail of its log, once that has become large."""
        self._bounded_log.limit()

    def activity(self) -> Activity:
        """Return what it, and all it has started, is doing."""
        raise NotImplementedError

    def core(self) -> int | None:
        """Return the core it has run on last, where it can be kept on one; None where not."""
        return None

    def place(self, place: Place) -> None:
        """Say where and when its threads run; nothing for one that shares our threads."""

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

    name: the participant. log: where its stdout and stderr go. has_terminal: they go where ours
    go instead, and its stdin is ours. pid: its process id and group.
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
        self._is_terminated = False
        try:
            with os.fdopen(append_to(log), "ab") as file:
                if has_terminal:
                    file.write(b"its output went to the terminal (--debug)\n")
                forked = None if has_terminal else fork(command, cwd, environment, file.fileno())
                self._process = forked or subprocess.Popen(
                    command,
                    cwd=cwd,
                    env=environment,
                    stdin=None if has_terminal else subprocess.DEVNULL,
                    stdout=None if has_terminal else file,
                    stderr=None if has_terminal else subprocess.STDOUT,
                    start_new_session=True,
                )
        except OSError as exc:
            is_script = exc.errno == errno.ENOEXEC
            hint = "; a script needs a first line with #! and its interpreter" if is_script else ""
            raise StartFailed(
                f"{name} could not be started: {' '.join(command)}: {exc.strerror or exc}{hint} "
                f"(participants.{name}.exec)",
                participant=name,
            ) from exc
        self.pid = self._process.pid

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

    def core(self) -> int | None:
        """Return the core it has run on last, where it can be kept on one."""
        return core_of(self.pid)

    def place(self, place: Place) -> None:
        """Place all its threads."""
        place_threads(self.pid, place)

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

    def signal(self, number: int) -> None:
        """Send a signal to it and all it has started; nothing once it has been reaped."""
        with self._lock, contextlib.suppress(ProcessLookupError, PermissionError):
            if self._process.returncode is None:
                os.killpg(self.pid, number)

    def activity(self) -> Activity:
        """Return what it, and all it has started, is doing."""
        return activity(self.pid)
