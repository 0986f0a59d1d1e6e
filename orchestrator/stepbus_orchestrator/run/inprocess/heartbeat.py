"""Shows a process outside which participant has the thread of a run; ends a run that hangs.

A participant that keeps Python's lock in C stops every thread of its process. So each turn is
noted in shared memory, which takes some writes, and a watcher reads it. Where the command hosts
participants, its parent watches (`cli/supervisor.py`); elsewhere, a child of the process that does
(`watch_parent.py`). Nothing but the standard library is needed here, so that it is there as soon as
the run is.
"""

import contextlib
import fcntl
import json
import math
import mmap
import os
import select
import signal
import time
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Any

from stepbus_orchestrator.processes.activity import activity_of

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
"""Where the numbers of the participants begin, which count from 1: the first step whose outputs
each has not published."""

TRACE_SIGNAL = signal.SIGURG
"""Ignored by default, so that one too many does no harm."""
TICK_S = 0.1
_LONGEST_TICK_S = 0.25
"""One look counts for at most this long: a machine that slept is no participant's fault (P12.1)."""
_PATIENCE_S = 0.5
"""How long a process may take to get on that has been interrupted [s]."""
_LEAVE_S = 5.0
"""How long a process may take to end after its run [s]."""
_INTERRUPTED_S = 1.0
_SWITCHES = 5
"""Times that a thread gives its processor away while it is expected to get on: one that waits for
Python's lock asks for it 200 times a second."""


class Stage(IntEnum):
    """How far a process is: no run yet; the phases of one; after it; all done but its end."""

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


class Heartbeat:
    """The shared memory, as both sides see it.

    file: its descriptor, which `close` closes; default: of a new one. It is closed when a program
    is started.
    """

    def __init__(self, file: int | None = None) -> None:
        if file is None:
            made = os.memfd_create("stepbus-heartbeat")
            os.ftruncate(made, _BYTES)
            file = fcntl.fcntl(made, fcntl.F_DUPFD_CLOEXEC, _FIRST_DESCRIPTOR)
            os.close(made)
        self.file = file
        self._memory = mmap.mmap(file, _WORDS_BYTES)
        self.words = memoryview(self._memory).cast("d")

    def close(self) -> None:
        """Give the memory back."""
        self.words.release()
        self._memory.close()
        os.close(self.file)

    def begin(self, will: dict[str, Any]) -> None:
        """Begin a run; will: what is to be known where the process ends in the midst, if it fits.

        names, limits, files: of each participant. limits: how long it may keep the thread in
        each stage of a run [s].
        """
        self.words[:] = memoryview(bytes(_WORDS_BYTES)).cast("d")
        os.ftruncate(self.file, _WORDS_BYTES)
        os.ftruncate(self.file, _BYTES)
        data = json.dumps(will).encode()
        if _WORDS_BYTES + len(data) < _TRACE_AT:
            os.pwrite(self.file, data, _WORDS_BYTES)
        # Where tracebacks are written next.
        os.lseek(self.file, _TRACE_AT, os.SEEK_SET)
        self.enter(Stage.READY)

    def enter(self, stage: Stage, code: int = 0) -> None:
        """Note how far the process is; code: with which it would end."""
        if stage is Stage.STEP:
            # What was published before was handshakes.
            self.words[PUBLISHED : 2 * MOST] = memoryview(bytes(8 * MOST)).cast("d")
        self.words[CODE] = code
        self.words[STAGE] = stage

    @property
    def stage(self) -> Stage:
        """Return how far the process is."""
        return Stage(int(self.words[STAGE]))

    def will(self) -> dict[str, Any]:
        """Return what was left; empty where nothing was."""
        content = os.pread(self.file, _TRACE_AT - _WORDS_BYTES, _WORDS_BYTES).rstrip(b"\0")
        return dict(json.loads(content)) if content else {}

    def trace(self) -> str:
        """Return the traceback of each thread; empty where it could not be had."""
        return os.pread(self.file, 1 << 20, _TRACE_AT).rstrip(b"\0").decode("utf-8", "replace")


own: Heartbeat | None = None
"""Set in a process that its parent watches, see `cli.supervisor`."""


class Watcher:
    """Interrupts, then kills a process that does not get on within a participant's deadline.

    is_owner: the process does nothing but this run, so that any thread that keeps Python's lock is
    of the run. held_s: how long it has not got on [s]. is_waiting: whether the thread of the run
    waits for Python's lock, which another one keeps. is_stopped: whether a signal or a debugger
    has stopped the process.
    """

    def __init__(self, heartbeat: Heartbeat, pid: int, *, is_owner: bool) -> None:
        self.held_s = 0.0
        self.is_waiting = self.is_stopped = False
        self.heartbeat = heartbeat
        self.pid = pid
        self._is_owner = is_owner
        self._progress: tuple[float, ...] = ()
        self._interrupted: tuple[float, int] | None = None
        self._looked_at = time.monotonic()

    def await_end(self, meanwhile: Callable[[], object] = lambda: None) -> bool:
        """Wait until the process has ended; return whether it was killed from here.

        meanwhile: is called every 0.1 s.
        """
        is_killed = False
        end = os.pidfd_open(self.pid)
        while not select.select([end], [], [], TICK_S)[0]:
            meanwhile()
            if not is_killed and self.is_late():
                is_killed = True
                signal.pidfd_send_signal(end, signal.SIGKILL)
        os.close(end)
        return is_killed

    def is_late(self) -> bool:
        """Return whether the process has to be killed; it is interrupted first. Ask every 0.1 s."""
        now, words = time.monotonic(), self.heartbeat.words
        elapsed_s, self._looked_at = min(now - self._looked_at, _LONGEST_TICK_S), now
        stage, turn = self.heartbeat.stage, int(words[TURN])
        # What changes as long as the process gets on.
        progress: tuple[float, ...] = (stage, words[PULSE])
        if turn:
            progress = (stage, words[TURNS], words[PUBLISHED + turn])
        elif stage is Stage.LEAVING:
            progress = (stage,)
        if progress != self._progress:
            self._progress, self._interrupted, self.held_s = progress, None, 0.0
            return False
        self.held_s += elapsed_s
        is_watched = stage is not Stage.BEFORE and (self._is_owner or turn > 0)
        # To read the limits takes a while, and hardly any participant comes near them.
        if not is_watched or self.held_s <= _LONGEST_TICK_S:
            return False
        if self.held_s <= self._limit_s(stage, turn):
            return False
        self.is_stopped = activity_of(self.pid).is_stopped
        if not self._is_owner and self.is_stopped:
            # By Ctrl-Z, which does not reach us: that is no participant's.
            self.held_s = 0.0
            return False
        if self._interrupted is None:
            self._interrupted = self.held_s, self._switches()
            # Its handler writes the tracebacks, and raises in what the participant executes.
            words[LATE] = self.held_s
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, TRACE_SIGNAL)
            return False
        at_s, switches = self._interrupted
        self.is_waiting = not turn or self._switches() - switches > _SWITCHES
        return self.held_s > at_s + _PATIENCE_S

    def _limit_s(self, stage: Stage, turn: int) -> float:
        if not stage.is_run:
            return _LEAVE_S
        rows: list[list[float]] = self.heartbeat.will().get("limits", [])
        # In no participant's turn, it may be any of them.
        some = rows[turn - 1 : turn] or rows
        limit_s = max((row[stage - 1] for row in some), default=math.inf)
        if self.heartbeat.words[INTERRUPTED]:
            limit_s = min(limit_s, _INTERRUPTED_S)
        return limit_s if turn else limit_s + _PATIENCE_S

    def _switches(self) -> int:
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
                if line.startswith("voluntary_ctxt_switches"):
                    return int(line.split()[1])
        return 0
