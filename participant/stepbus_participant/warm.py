"""One process that has loaded what participants need, and becomes each of them by a fork.

`python -P -m stepbus_participant --warm…` is told on its standard input, a socket, which ones are
wanted. A child goes on in `__main__` as if it had been started for its participant alone.
"""

import contextlib
import ctypes
import gc
import mmap
import os
import signal
import socket
import sys
from importlib import import_module
from pathlib import Path

import msgspec

from .bus.ticket import TICKET_VARIABLE

WARM = "--warm"
_PR_SET_PDEATHSIG = 1
_LONGEST = 1 << 16
_ARGUMENTS, _ENVIRONMENT = 47, 49
"""Where /proc/self/stat has the addresses of both, counted from 0."""


class Birth(msgspec.Struct, frozen=True):
    """A participant that is wanted. words: its command. folder: where it works."""

    words: list[str]
    folder: str
    ticket: str


def become_participants(modules: list[str]) -> str:
    """Return in a new process for each participant that is wanted, its class; else never.

    modules: are loaded before. The first process ends with its parent,
    with the socket, and where a module has started a thread: it must not fork then.
    """
    process = ctypes.CDLL(None)
    process.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    gc.disable()
    for name in modules:
        # A participant that needs it says what is wrong.
        with contextlib.suppress(Exception):
            import_module(name)
    # What libraries in C have printed would come from each child once more.
    process.fflush(None)
    # A child that changes the count of references to something copies its page.
    gc.freeze()
    with socket.socket(fileno=os.dup(0)) as channel:
        while True:
            data, files, _, _ = socket.recv_fds(channel, _LONGEST, 1)
            if not data or len(os.listdir("/proc/self/task")) > 1:  # noqa: PTH208  (pathlib is slower)
                os._exit(0)
            pid = _fork()
            if pid is None:
                break
            os.close(files[0])
            channel.send(str(pid).encode())
    gc.enable()
    birth = msgspec.json.decode(data, type=Birth)
    _settle(birth, files[0])
    return birth.words[-1]


def _fork() -> int | None:
    """Return None in a new process, and here its process id; 0: there is none.

    Its parent has ended, so it is a child of the subreaper above us, the orchestrator.
    """
    shared = mmap.mmap(-1, 4)
    if (between := os.fork()) == 0:
        if (pid := os.fork()) == 0:
            return None
        shared[:] = pid.to_bytes(4)
        os._exit(0)
    os.waitpid(between, 0)  # no time-out: it does nothing but fork
    return int.from_bytes(shared)


def _settle(birth: Birth, log: int) -> None:
    """Be what `birth` says, as an own start would have made it."""
    # First its ticket: the orchestrator knows it by that, or by the session.
    _show(birth)
    os.setsid()
    null = os.open(os.devnull, os.O_RDWR)
    for number, file in enumerate((null, log, log)):
        os.dup2(file, number)
    os.close(null)
    os.close(log)
    os.chdir(birth.folder)
    os.environ[TICKET_VARIABLE] = birth.ticket
    sys.orig_argv[1:] = birth.words[1:]


def _show(birth: Birth) -> None:
    """Let /proc have its command and its ticket: the reaper knows what it leaves behind by that.

    Both take the room that the command and the environment of the first process have.
    """
    stat = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    shown = []
    for field in (_ARGUMENTS - 2, _ENVIRONMENT - 2):
        first, end = int(stat[field]), int(stat[field + 1])
        shown.append((first, ctypes.string_at(first, end - first)))
    (arguments, words), (variables, content) = shown
    _write(arguments, len(words), b"\0".join(word.encode() for word in birth.words))
    name = f"\0{TICKET_VARIABLE}=".encode()
    at = (b"\0" + content).index(name) + len(name) - 1
    _write(variables + at, content.index(b"\0", at) - at, birth.ticket.encode())


def _write(address: int, room: int, text: bytes) -> None:
    ctypes.memmove(address, text[:room].ljust(room, b"\0"), room)
