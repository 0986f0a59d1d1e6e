"""Who has the thread of a run in one process, in memory that a process outside of it reads.

A participant that keeps Python's lock in C stops every thread of its process. So each turn is
noted here, which takes some writes into memory, and `turn_watchdog.py` reads it from outside.
"""

import fcntl
import json
import mmap
import os
from enum import IntEnum
from typing import Any

MOST = 1024
"""Participants; those beyond are one to who watches."""
_WORDS_BYTES = 1 << 16
_TRACE_AT = 3 << 16
_BYTES = 1 << 18
"""Half of what a recording takes, where the size of files is limited."""
_FIRST_DESCRIPTOR = 10
"""Below are the standard streams, one of which may be closed."""


class Word(IntEnum):
    """Where each number is.

    COUNT: of turns. TURN: who has the thread. PULSE: counts while Python's lock is to be had.
    STAGE, CODE: how far the process is, and its exit code. LEFT: who has left a thread behind.
    LATE: set before the process is interrupted from outside: how long a participant has had the
    thread [s]. GONE: whether nobody watches any more.
    """

    COUNT = 0
    TURN = 1
    PULSE = 2
    STAGE = 3
    CODE = 4
    LEFT = 5
    LATE = 6
    GONE = 7


class Row(IntEnum):
    """Where the numbers of each participant begin, which count from 1.

    PUBLISHED: outputs so far. UNCOUNTED: those before the first step. LIMIT: how long it may keep
    the thread [s]; at 0: anybody. DEADLINE: by which of `DEADLINES`. THREADS: that it has started.
    """

    PUBLISHED = 1 * MOST
    UNCOUNTED = 2 * MOST
    LIMIT = 3 * MOST
    DEADLINE = 4 * MOST
    THREADS = 5 * MOST


class Stage(IntEnum):
    """How far a process is: no run yet, in one, behind it, and all done but its end."""

    BEFORE = 0
    RUNNING = 1
    OVER = 2
    LEAVING = 3


DEADLINES = ("ready", "step", "stop")


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

    def close(self) -> None:
        """Give the memory back."""
        self.words.release()
        self._memory.close()
        os.close(self.file)

    def enter(self, stage: Stage, code: int = 0) -> None:
        """Note how far the process is; code: with which it would end."""
        words = self.words
        if stage is Stage.RUNNING and words[Word.STAGE] != stage:
            words[: Word.GONE] = _zeros(Word.GONE)
            words[MOST:] = _zeros(len(words) - MOST)
        words[Word.CODE] = code
        words[Word.STAGE] = stage

    def limit(self, number: int, limit_s: float, deadline: int) -> None:
        """Note how long a participant may keep the thread for one step [s], and by which deadline.

        To be repeated whenever that changes.
        """
        words = self.words
        if not words[Row.DEADLINE + number]:
            words[Row.UNCOUNTED + number] = words[Row.PUBLISHED + number]
        words[Row.LIMIT + number], words[Row.DEADLINE + number] = limit_s, deadline
        words[Row.LIMIT], words[Row.DEADLINE] = max(words[Row.LIMIT], limit_s), deadline

    def write(self, content: dict[str, Any]) -> None:
        """Leave what is to be known where the process ends in the midst of the run, if it fits."""
        data = json.dumps(content).encode()
        if _WORDS_BYTES + 8 + len(data) < _TRACE_AT:
            os.pwrite(self.file, len(data).to_bytes(8, "little") + data, _WORDS_BYTES)

    def open_trace(self) -> int:
        """Return a descriptor to write tracebacks to, which has a position of its own."""
        file = os.open(f"/proc/self/fd/{self.file}", os.O_WRONLY | os.O_CLOEXEC)
        os.lseek(file, _TRACE_AT, os.SEEK_SET)
        return file

    # --- the side of who watches ----------------------------------------------------------

    def steps(self, number: int) -> int:
        """Return how many steps a participant has published."""
        return int(self.words[Row.PUBLISHED + number] - self.words[Row.UNCOUNTED + number])

    def with_threads(self) -> list[int]:
        """Return who has started threads of its own."""
        return [number for number in range(1, MOST) if self.words[Row.THREADS + number]]

    def read(self) -> dict[str, Any]:
        """Return what was left; empty where nothing was."""
        size = int.from_bytes(os.pread(self.file, 8, _WORDS_BYTES), "little")
        content = os.pread(self.file, size, _WORDS_BYTES + 8)
        return dict(json.loads(content)) if content else {}

    def trace(self) -> str:
        """Return the traceback of each thread; empty where it could not be had."""
        return os.pread(self.file, 1 << 20, _TRACE_AT).rstrip(b"\0").decode("utf-8", "replace")


def _zeros(number: int) -> "memoryview[float]":
    return memoryview(bytes(8 * number)).cast("d")


own: Turns | None = None
"""Set in a process that its parent watches, see `cli.supervisor`."""
