"""Deadlines of participants that share our thread, kept from a thread of its own (P12).

A participant that does not come back keeps the thread, and with it the orchestrator. The watch sees
that from outside: it names the line of code, and interrupts it there.
"""

import ctypes
import faulthandler
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, ClassVar

from stepbus_orchestrator.run.kernel.participants import KeptThread

from .host import HostedParticipant, Late

_CHECK_S = 0.1
_LONGEST_CHECK_S = 0.25
_INTERRUPT_S = 1.0
"""How long a participant may go on after Ctrl-C [s]."""
_REPEAT_S = 1.0
_JOIN_S = 1.0
_LAST_RESORT_S = 10.0
_SIGNAL = signal.SIGURG
"""Ignored by default, so that one too many does no harm."""


class Watch:
    """Interrupts a participant that keeps the thread for longer than its deadline.

    current: returns who has the thread, and how many steps it has published. limit_s: returns how
    long it may keep it for one step [s]. interrupted: whether the user ends the run.

    Code in C that never returns to Python cannot be interrupted. Where it keeps Python's lock as
    well, this process ends, 10 s later, with the traceback of every thread.
    """

    _open: ClassVar[list["Watch"]] = []
    _before: ClassVar[Any] = None

    def __init__(
        self,
        current: Callable[[], tuple[HostedParticipant, int] | None],
        limit_s: Callable[[str], float],
        interrupted: Callable[[], bool],
    ) -> None:
        self._current = current
        self._limit_s = limit_s
        self._interrupted = interrupted
        self._thread_id = threading.get_ident()
        self._is_main = threading.current_thread() is threading.main_thread()
        self._over = threading.Event()
        self._late: KeptThread | None = None
        self._is_armed = False
        if self._is_main:
            self._handle()
        self._thread = threading.Thread(target=self._watch, name="watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._over.set()
        self._thread.join(_JOIN_S)
        self._disarm()
        if self._is_main:
            Watch._open.remove(self)
            if not Watch._open:
                signal.signal(_SIGNAL, Watch._before)

    def _handle(self) -> None:
        """Handle the signal as long as any run in this process is watched."""
        if not Watch._open:
            Watch._before = signal.signal(_SIGNAL, Watch._raise_late)
        Watch._open.append(self)

    @staticmethod
    def _raise_late(_number: int, _frame: FrameType | None) -> None:
        for watch in tuple(Watch._open):
            watch._raise()

    def _disarm(self) -> None:
        # It is one of this process: other runs in it have it too.
        if self._is_armed:
            self._is_armed = False
            faulthandler.cancel_dump_traceback_later()

    def _watch(self) -> None:
        held: tuple[HostedParticipant, int] | None = None
        held_s, checked_at, patience_s = 0.0, time.monotonic(), 0.0
        while not self._over.wait(_CHECK_S):
            now = time.monotonic()
            elapsed_s, checked_at = min(now - checked_at, _LONGEST_CHECK_S), now
            holder = self._current()
            if holder is None or holder != held:
                held, held_s, patience_s = holder, 0.0, 0.0
                self._disarm()
                continue
            held_s += elapsed_s
            limit_s = self._limit_s(holder[0].name)
            if self._interrupted():
                limit_s = min(limit_s, _INTERRUPT_S)
            # A thread of C, armed anew at each check: it fires where even this one cannot run.
            self._is_armed = True
            faulthandler.dump_traceback_later(limit_s + _LAST_RESORT_S, exit=True)
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
            signal.pthread_kill(self._thread_id, _SIGNAL)
        else:
            thread, error = ctypes.c_ulong(self._thread_id), ctypes.py_object(Late)
            holder.late = self._late
            ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, error)

    def _raise(self) -> None:
        """Raise in the midst of the participant, unless it has come back meanwhile."""
        late, self._late = self._late, None
        holder = self._current()
        if late is not None and holder is not None and holder[0].is_running():
            holder[0].late = late
            raise Late(f"interrupted after {late.held_s:.1f} s {late.where and f'at {late.where}'}")


def _where(frame: FrameType | None) -> str:
    """Return `file.py:12 in update`: the newest line that is not the library's."""
    found = frame
    while found is not None and "/lib/python" in found.f_code.co_filename:
        found = found.f_back
    found = found or frame
    if found is None:
        return "an unknown line"
    code = found.f_code
    return f"{Path(code.co_filename).name}:{found.f_lineno} in {code.co_name}"
