"""Deadlines of participants that share our thread, kept from a thread of its own (P12).

A participant that does not come back keeps the thread, and with it the orchestrator. The watch sees
that from outside: it names the line of code, and interrupts it there.
"""

import contextlib
import ctypes
import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, ClassVar

from stepbus_orchestrator.processes import turn_watchdog, turns
from stepbus_orchestrator.processes.child import BoundedLog
from stepbus_orchestrator.processes.turn_watchdog import TRACE_SIGNAL
from stepbus_orchestrator.processes.turns import Stage, Turns, Word, make_file
from stepbus_orchestrator.run.inprocess.participant import HostedParticipant, Late
from stepbus_orchestrator.run.kernel.participants import KeptThread

_CHECK_S = 0.1
_LONGEST_CHECK_S = 0.25
_INTERRUPT_S = 1.0
"""How long a participant may go on after Ctrl-C [s]."""
_REPEAT_S = 1.0
_JOIN_S = 1.0


class Watch:
    """Interrupts a participant that keeps the thread for longer than its deadline.

    current: returns who has the thread, and how many steps it has published. limit_s: returns how
    long it may keep it for one step [s]. interrupted: whether the user ends the run. memory:
    shared with who watches from outside. logs: kept short.

    Code in C that never returns to Python cannot be interrupted: `turn_watchdog.py` ends it all.
    """

    _open: ClassVar[list["Watch"]] = []
    _before: ClassVar[Any] = None

    def __init__(
        self,
        current: Callable[[], tuple[HostedParticipant, int] | None],
        limit_s: Callable[[str], float],
        interrupted: Callable[[], bool],
        memory: Turns,
        logs: Sequence[BoundedLog],
    ) -> None:
        self._current = current
        self._limit_s = limit_s
        self._interrupted = interrupted
        self._memory = memory
        self._logs = logs
        self._thread_id = threading.get_ident()
        self._is_main = threading.current_thread() is threading.main_thread()
        self._over = threading.Event()
        self._late: KeptThread | None = None
        if self._is_main:
            self._handle()
        self._thread = threading.Thread(target=self._watch, name="watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._over.set()
        self._thread.join(_JOIN_S)
        if self._is_main:
            Watch._open.remove(self)
            if not Watch._open:
                signal.signal(TRACE_SIGNAL, Watch._before)

    def _handle(self) -> None:
        """Handle the signal as long as any run in this process is watched."""
        if not Watch._open:
            Watch._before = signal.signal(TRACE_SIGNAL, Watch._raise_late)
        Watch._open.append(self)

    @staticmethod
    def _raise_late(_number: int, frame: FrameType | None) -> None:
        for watch in tuple(Watch._open):
            watch._raise(frame)

    def _watch(self) -> None:
        held: tuple[HostedParticipant, int] | None = None
        held_s, checked_at, patience_s = 0.0, time.monotonic(), 0.0
        while not self._over.wait(_CHECK_S):
            for log in self._logs:
                log.limit()
            now = time.monotonic()
            elapsed_s, checked_at = min(now - checked_at, _LONGEST_CHECK_S), now
            holder = self._current()
            if holder is None or holder != held:
                held, held_s, patience_s = holder, 0.0, 0.0
                continue
            held_s += elapsed_s
            limit_s = self._limit_s(holder[0].name)
            if self._interrupted():
                limit_s = min(limit_s, _INTERRUPT_S)
            if held_s > max(limit_s, patience_s):
                patience_s = held_s + _REPEAT_S
                self._interrupt(holder[0], held_s)

    def _interrupt(self, holder: HostedParticipant, held_s: float) -> None:
        """Raise `Late` in what a participant executes, and end the programs it waits for."""
        if holder.has_programs:
            self._late = KeptThread(held_s, "", holder.activity().is_stopped)
        else:
            frame = sys._current_frames().get(self._thread_id)
            self._late = KeptThread(held_s, _where(frame))
        holder.kill_programs()
        if self._is_main:
            signal.pthread_kill(self._thread_id, TRACE_SIGNAL)
        else:
            thread, error = ctypes.c_ulong(self._thread_id), ctypes.py_object(Late)
            holder.late = self._late
            ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, error)

    def _raise(self, frame: FrameType | None) -> None:
        """Raise in the midst of the participant, unless it has come back meanwhile."""
        late, self._late = self._late, None
        held_s, self._memory.words[Word.LATE] = self._memory.words[Word.LATE], 0.0
        if late is None and held_s:
            # It kept Python's lock, so that our thread has not seen it.
            late = KeptThread(held_s, _where(frame))
        holder = self._current()
        if late is not None and holder is not None and holder[0].is_running():
            holder[0].late = late
            raise Late(f"interrupted after {late.held_s:.1f} s {late.where and f'at {late.where}'}")


@contextlib.contextmanager
def traced(memory: Turns) -> Iterator[None]:
    """Let who watches from outside have the tracebacks, and end this process."""
    trace = memory.open_trace()
    # Written in C, by whichever thread gets the signal, whoever keeps the lock.
    faulthandler.register(TRACE_SIGNAL, trace, all_threads=True, chain=True)
    memory.enter(Stage.RUNNING)
    try:
        yield
    finally:
        memory.enter(Stage.OVER)
        faulthandler.unregister(TRACE_SIGNAL)
        os.close(trace)


@contextlib.contextmanager
def watched_from_outside() -> Iterator[Turns]:
    """Yield a memory that another process watches: our parent, or else a child."""
    if turns.own is not None:
        yield turns.own
        return
    watchdog = _idle() or _Outside()
    try:
        yield watchdog.memory
    finally:
        watchdog.memory.enter(Stage.OVER)
        _Outside.idle.append(watchdog)


class _Outside:
    """A child that watches us. It serves one run after the other, and ends when none comes."""

    idle: ClassVar[list["_Outside"]] = []

    def __init__(self) -> None:
        self.memory = Turns(make_file())
        self._owner = os.getpid()
        command = [sys.executable, "-I", "-S", turn_watchdog.__file__, "3", str(self._owner)]
        actions = [
            (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
            (os.POSIX_SPAWN_DUP2, self.memory.file, 3),
        ]
        self._pid = os.posix_spawn(
            sys.executable, command, os.environ, file_actions=actions, setsid=True
        )

    def is_there(self) -> bool:
        """Return whether it will watch one more run."""
        if os.getpid() != self._owner:
            return False
        self.memory.enter(Stage.RUNNING)
        if not self.memory.words[Word.GONE] and os.waitpid(self._pid, os.WNOHANG)[0] == 0:
            return True
        self.memory.enter(Stage.OVER)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self._pid, os.WNOHANG)
        self.memory.close()
        return False


def _idle() -> _Outside | None:
    """Return a child that has nothing to watch, if there is one."""
    while _Outside.idle:
        watchdog = _Outside.idle.pop()
        with contextlib.suppress(ChildProcessError):
            if watchdog.is_there():
                return watchdog
    return None


def _where(frame: FrameType | None) -> str:
    """Return `file.py:12 in update`: the newest line that is not the library's."""
    place = frame
    while place is not None and "/lib/python" in place.f_code.co_filename:
        place = place.f_back
    place = place or frame
    if place is None:
        return "an unknown line"
    code = place.f_code
    return f"{Path(code.co_filename).name}:{place.f_lineno} in {code.co_name}"
