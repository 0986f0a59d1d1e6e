"""A process that has loaded what participants need, from which those that are classes are forked.

It is started like any of them, with the same interpreter and the same environment, before anything
else is loaded here. What it cannot become is started as ever: a program, a class with another
environment, one in a debugger.
"""

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from stepbus_orchestrator.processes import PYTHON
from stepbus_orchestrator.processes.activity import children
from stepbus_orchestrator.scenario.program import PYTHON as INTERPRETER
from stepbus_participant import ONE_THREAD, TICKET_VARIABLE, environment, is_ours
from stepbus_participant.warm import REFUSED, WARM, Birth

_COMMAND = (*INTERPRETER, "-m", "stepbus_participant")
_PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 36, 37
_ANSWER_S = 10.0
"""How long it may take to load what it has to, and to fork [s]; it may have been stopped."""
_PAUSE_S = 0.001
_ROOM = " " * 250
_TICKET_ROOM = " " * 4095
"""What the command of a participant, and the path of its ticket, take the place of."""
_COVERAGE = ("COVERAGE_PROCESS_START", "COVERAGE_PROCESS_CONFIG")
"""It measures a process from its start on."""


class Forked:
    """A child of ours that another process has forked, as far as `subprocess.Popen` is needed."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def wait(self, timeout: float) -> int:
        """Return its exit code, and reap it; raises TimeoutExpired."""
        give_up = time.monotonic() + timeout
        while self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
            elif time.monotonic() > give_up:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            else:
                time.sleep(_PAUSE_S)
        return self.returncode


def participant_environment(ticket: str) -> Mapping[str, str]:
    """Return the environment of a participant: ours, the path of its ticket, unbuffered prints."""
    return {**ONE_THREAD, **environment(), **PYTHON, TICKET_VARIABLE: ticket}


class _Parent:
    """The process. names: modules and classes that it loads; raises OSError when there is none.

    is_kept: several runs have it.
    """

    def __init__(self, names: Sequence[str], *, is_kept: bool) -> None:
        self.is_kept = is_kept
        self._lock = threading.Lock()
        self._is_there = False
        self._environment = participant_environment(_TICKET_ROOM)
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(_ANSWER_S)
        with theirs, Path(os.devnull).open("r+b") as null, contextlib.ExitStack() as stack:
            stack.callback(self._channel.close)
            places = ((theirs, 0), (null, 1), (null, 2))
            self._pid = os.posix_spawn(
                _COMMAND[0],
                [*_COMMAND, WARM + _ROOM, *names],
                self._environment,
                file_actions=[(os.POSIX_SPAWN_DUP2, one.fileno(), at) for one, at in places],
                setsid=True,
            )
            stack.pop_all()
        self._is_there = True

    def fork(
        self, command: Sequence[str], cwd: Path, environment: Mapping[str, str], log: int
    ) -> Forked | None:
        is_alike = {**environment, TICKET_VARIABLE: _TICKET_ROOM} == self._environment
        if tuple(command[:-1]) != _COMMAND or not is_alike or not cwd.is_dir():
            return None
        try:
            birth = msgspec.json.encode(
                Birth(list(command), str(cwd), environment[TICKET_VARIABLE])
            )
        except UnicodeEncodeError:
            # A folder may have a name that is no text.
            return None
        with self._lock:
            if not self._is_there:
                return None
            with _subreaper():
                with contextlib.suppress(OSError):
                    socket.send_fds(self._channel, [birth], [log])
                    if (pid := int(self._channel.recv(32) or REFUSED)) != REFUSED:
                        return Forked(pid)
                # It is stopped or killed, or short of something, and must not fork later on.
                self._end(environment[TICKET_VARIABLE])
        return None

    def end(self) -> None:
        with self._lock:
            self._end()

    def _end(self, ticket: str = "") -> None:
        """End it; ticket: of a participant that it may have forked without an answer."""
        if self._is_there:
            self._is_there = False
            self._channel.close()
            # A program of the user's may have reaped it.
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                os.kill(self._pid, signal.SIGKILL)
                # As long as it is a zombie, its session is its own.
                # no time-out: it was killed
                os.waitid(os.P_PID, self._pid, os.WEXITED | os.WNOWAIT)
                while ticket and (forked := self._forked(ticket)):
                    for pid in forked:
                        os.kill(pid, signal.SIGKILL)
                        os.waitpid(pid, 0)  # no time-out: it was killed
                os.waitpid(self._pid, 0)  # no time-out: it was killed

    def _forked(self, ticket: str) -> list[int]:
        """Return its children, now ours: they are in its session until they show their ticket."""
        mark = f"{TICKET_VARIABLE}={ticket}".encode()
        return [
            pid
            for pid in children(os.getpid()) - {self._pid}
            if os.getsid(pid) == self._pid or mark in _variables(pid)
        ]


def _variables(pid: int) -> list[bytes]:
    # One that has become another user's does not show them.
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    return []


_adopting = threading.Lock()


@contextlib.contextmanager
def _subreaper() -> Iterator[None]:
    """Become the parent of those whose own one ends, for the moment of a fork."""
    call, was = ctypes.CDLL(None).prctl, ctypes.c_int()
    # It is the whole process's: another thread may be forking from a parent of its own.
    with _adopting:
        call(_PR_GET_CHILD_SUBREAPER, ctypes.byref(was))
        call(_PR_SET_CHILD_SUBREAPER, 1)
        try:
            yield
        finally:
            call(_PR_SET_CHILD_SUBREAPER, was.value)


_parent: _Parent | None = None


@contextlib.contextmanager
def warm_parent(classes: Collection[str] | None = None, *, runs: int = 1) -> Iterator[None]:
    """Fork the participants of all runs in this context, where they are classes.

    classes: those of a run; None: they are not known yet. It takes two for a warm parent to be
    worth its start. runs: how many there are; where several have these classes, those of our
    packages are loaded once.
    """
    global _parent  # noqa: PLW0603  (a run knows nothing of those that follow)
    is_able = sys.platform == "linux" and not any(name in os.environ for name in _COVERAGE)
    made = None
    if _parent is None and is_able and (classes is None or len(classes) > 1):
        with contextlib.suppress(OSError):
            made = _parent = _Parent(_names(classes, runs), is_kept=runs > 1)
    try:
        yield
    finally:
        if made is not None:
            _parent = None
            made.end()


def _names(classes: Collection[str] | None, runs: int) -> list[str]:
    """Return what it loads, as of `warm_parent`."""
    ours = sorted(set(filter(is_ours, classes or ())))
    numbers = ["numpy"] if ours or classes is None else []
    return ["zenoh", *numbers, *(ours if runs > 1 else [])]


def all_started() -> None:
    """End the warm parent of a run whose participants have all been started."""
    # A run in another thread may take it away at any time.
    parent = _parent
    if parent is not None and not parent.is_kept:
        parent.end()


def fork(
    command: Sequence[str], cwd: Path, environment: Mapping[str, str], log: int
) -> Forked | None:
    """Return the process of a participant; None where it has to be started.

    cwd: its folder. log: descriptor of where it prints.
    """
    parent = _parent
    return None if parent is None else parent.fork(command, cwd, environment, log)
