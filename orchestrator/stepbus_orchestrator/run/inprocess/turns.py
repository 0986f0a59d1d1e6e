"""Which participant has the thread of a run, in memory that another process reads.

A participant that keeps Python's lock in C stops every thread of its process. So each turn is
noted here, which takes some writes into memory, and `turn_watchdog.py` reads it from outside.
"""

import fcntl
import json
import mmap
import os
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

MOST = 1024
"""Participants; the watcher takes those beyond for one."""
_WORDS_BYTES = 1 << 16
_TRACE_AT = 3 << 16
_BYTES = 1 << 18
"""Half of what a recording takes, where the size of files is limited."""
_FIRST_DESCRIPTOR = 10
"""Below are the standard streams, one of which may be closed."""

STAGE, CODE, TURN, TURNS, PULSE, LATE, INTERRUPTED = range(7)
"""Where each number is: how far the process is, and its exit code; who has the thread (0: no
participant), and how many turns there were; what counts while Python's lock is to be had; how
long the participant has had the thread that is to be interrupted [s]; whether the user wants the
run to end."""
PUBLISHED = MOST
"""Where the numbers of the participants begin, which count from 1: how many steps each has
published."""


class Stage(IntEnum):
    """How far a process is: no run yet; the phases of one; behind it; all done but its end."""

    BEFORE = 0
    READY = 1
    STEP = 2
    STOP = 3
    OVER = 4
    LEAVING = 5

    @property
    def is_run(self) -> bool:
        """Return whether participants have turns."""
        return Stage.READY <= self <= Stage.STOP


@dataclass
class Kept:
    """How long a process has not got on [s].

    is_waiting: whether the thread of the run waits for Python's lock, which another one keeps.
    is_stopped: whether a signal or a debugger has stopped the process.
    """

    held_s: float = 0.0
    is_waiting: bool = False
    is_stopped: bool = False


def make_file() -> int:
    """Return the descriptor of such a memory; it is closed when a program is started."""
    file = os.memfd_create("stepbus-turns")
    os.ftruncate(file, _BYTES)
    high = fcntl.fcntl(file, fcntl.F_DUPFD_CLOEXEC, _FIRST_DESCRIPTOR)
    os.close(file)
    return high


class Turns:
    """The memory as both sides see it. file: its descriptor, which `close` closes."""

    def __init__(self, file: int) -> None:
        self.file = file
        self._memory = mmap.mmap(file, _WORDS_BYTES)
        self.words = memoryview(self._memory).cast("d")
        self._trace = -1

    def close(self) -> None:
        """Give the memory back."""
        if self._trace >= 0:
            os.close(self._trace)
        self.words.release()
        self._memory.close()
        os.close(self.file)

    def begin(self, will: dict[str, Any]) -> None:
        """Begin a run; will: what is to be known where the process ends in the midst, if it fits.

        names, every, limits, files: of each participant. limits: how long it may keep the thread in
        each stage of a run [s].
        """
        self.words[:] = memoryview(bytes(_WORDS_BYTES)).cast("d")
        os.ftruncate(self.file, _TRACE_AT)
        os.ftruncate(self.file, _BYTES)
        data = json.dumps(will).encode()
        if _WORDS_BYTES + 8 + len(data) < _TRACE_AT:
            os.pwrite(self.file, len(data).to_bytes(8, "little") + data, _WORDS_BYTES)
        self.enter(Stage.READY)

    def enter(self, stage: Stage, code: int = 0) -> None:
        """Note how far the process is; code: with which it would end."""
        if stage is Stage.STEP:
            # What was published before was handshakes.
            self.words[PUBLISHED : 2 * MOST] = memoryview(bytes(8 * MOST)).cast("d")
        self.words[CODE] = code
        self.words[STAGE] = stage

    def trace_file(self) -> int:
        """Return a descriptor to write tracebacks to, which has a position of its own."""
        if self._trace < 0:
            self._trace = os.open(f"/proc/self/fd/{self.file}", os.O_WRONLY | os.O_CLOEXEC)
        os.lseek(self._trace, _TRACE_AT, os.SEEK_SET)
        return self._trace

    # --- the side of the watcher ----------------------------------------------------------

    @property
    def stage(self) -> Stage:
        """Return how far the process is."""
        return Stage(int(self.words[STAGE]))

    def will(self) -> dict[str, Any]:
        """Return what was left; empty where nothing was."""
        size = int.from_bytes(os.pread(self.file, 8, _WORDS_BYTES), "little")
        content = os.pread(self.file, size, _WORDS_BYTES + 8)
        return dict(json.loads(content)) if content else {}

    def trace(self) -> str:
        """Return the traceback of each thread; empty where it could not be had."""
        return os.pread(self.file, 1 << 20, _TRACE_AT).rstrip(b"\0").decode("utf-8", "replace")


own: Turns | None = None
"""Set in a process that its parent watches, see `cli.supervisor`."""
