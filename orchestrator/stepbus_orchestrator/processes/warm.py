"""A process that has loaded the usual libraries, and from which classes are forked.

It is started with the interpreter and the environment of a participant, before anything else is
loaded here. A program, a class with another environment, and a class in a debugger are started
without it.
"""

import contextlib
import ctypes
import os
import socket
import subprocess
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes import PYTHON
from stepbus_orchestrator.scenario.program import PYTHON as INTERPRETER
from stepbus_participant import ONE_THREAD, TICKET_VARIABLE
from stepbus_participant.warm import WARM, Birth

_COMMAND = (*INTERPRETER, "-m", "stepbus_participant")
_PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 36, 37
_LIBRARIES = ("zenoh", "numpy")
"""What nearly every class loads."""
_ANSWER_S = 10.0
"""How long it may take to load its libraries, and to fork [s]; it may have been stopped."""
_FORKING = threading.Lock()
"""Of all runs of this process: one must not take back what another one needs."""
_ROOM = " " * 250
_TICKET_ROOM = " " * 4095
"""What the command of a participant, and the path of its ticket, take the place of."""


def participant_environment(ticket: str) -> Mapping[str, str]:
    """Return the environment of a participant: ours, the path of its ticket, unbuffered prints."""
    return {**ONE_THREAD, **os.environ, **PYTHON, TICKET_VARIABLE: ticket}


class _Parent:
    """The process; raises OSError when it cannot be started."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._environment = participant_environment(_TICKET_ROOM)
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(_ANSWER_S)
        with theirs, contextlib.ExitStack() as stack:
            stack.callback(self._channel.close)
            self._process = subprocess.Popen(
                [*_COMMAND, WARM + _ROOM, *_LIBRARIES],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=self._environment,
                start_new_session=True,
            )
            stack.pop_all()

    def fork(
        self, command: Sequence[str], cwd: Path, environment: Mapping[str, str], log: int
    ) -> int | None:
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
        with self._lock, _subreaper():
            try:
                socket.send_fds(self._channel, [birth], [log])
                answer = self._channel.recv(32)
            except TimeoutError:
                pid = self._process.pid
                self._end()
                raise StartFailed(
                    f"process {pid}, which is to start {command[-1]}, does not answer; is it "
                    "stopped?"
                ) from None
            except OSError:
                # It has ended: another thread has ended it, or its own.
                answer = b""
        return int(answer) if answer else None

    def end(self) -> None:
        with self._lock:
            self._end()

    def _end(self) -> None:
        self._channel.close()
        self._process.kill()
        self._process.wait()  # no time-out: it was killed


@contextlib.contextmanager
def _subreaper() -> Iterator[None]:
    """Become the parent of those whose own one ends, for the moment of a fork."""
    call, was = ctypes.CDLL(None).prctl, ctypes.c_int()
    with _FORKING:
        call(_PR_GET_CHILD_SUBREAPER, ctypes.byref(was))
        call(_PR_SET_CHILD_SUBREAPER, 1)
        try:
            yield
        finally:
            call(_PR_SET_CHILD_SUBREAPER, was.value)


_parent: _Parent | None = None


@contextlib.contextmanager
def warm_parent(classes: int | None = None) -> Iterator[None]:
    """Fork the participants of a run in this context, where they are classes.

    classes: how many these are; None: not known yet. It takes two for a warm parent to be worth its
    start.
    """
    global _parent  # noqa: PLW0603  (a run knows nothing of those that follow)
    made = None
    if _parent is None and classes not in {0, 1}:
        with contextlib.suppress(OSError):
            made = _parent = _Parent()
    try:
        yield
    finally:
        if made is not None:
            _parent = None
            made.end()


def all_started() -> None:
    """End the warm parent of a run whose participants have all been started."""
    # A run in another thread may take it away at any time.
    parent = _parent
    if parent is not None:
        parent.end()


def fork(command: Sequence[str], cwd: Path, environment: Mapping[str, str], log: int) -> int | None:
    """Return the process id of a participant, a child of ours; None where it has to be started.

    cwd: its folder. log: descriptor of where it prints. Raises StartFailed when the warm parent
    does not answer.
    """
    parent = _parent
    return None if parent is None else parent.fork(command, cwd, environment, log)
