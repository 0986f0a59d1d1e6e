"""Interrupts a participant that keeps the thread past its deadline (P12).

A process outside of this one keeps the deadlines, since a participant that does not come back may
keep Python's lock. It sends a signal, whose handler names the line of code and raises there; where
that is of no use, it ends this process, see `turn_watchdog.py`.
"""

import contextlib
import ctypes
import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

from stepbus_orchestrator.run.inprocess import turn_watchdog, turns
from stepbus_orchestrator.run.inprocess.hub import HostedParticipant, Hub, Late
from stepbus_orchestrator.run.inprocess.turn_watchdog import TRACE_SIGNAL
from stepbus_orchestrator.run.inprocess.turns import INTERRUPTED, LATE, Stage, Turns, make_file

_CHECK_S = 0.1
_JOIN_S = 1.0

_handling: list["Watch"] = []
"""Those whose runs are on the main thread; the first installs the handler, the last removes it."""


class Watch:
    """Watches the participants of a run, from when it is made until it is closed.

    hub: knows who has the thread. is_interrupted: whether the user ends the run. memory: that
    another process watches: our parent, or else a child.
    """

    def __init__(self, hub: Hub, is_interrupted: Callable[[], bool]) -> None:
        self._hub = hub
        self._is_interrupted = is_interrupted
        self._stack = contextlib.ExitStack()
        self._thread_id = threading.get_ident()
        self._is_main = threading.current_thread() is threading.main_thread()
        self._over = threading.Event()
        with contextlib.ExitStack() as stack:
            self.memory = stack.enter_context(_watched_memory())
            stack.enter_context(self._handled())
            thread = threading.Thread(target=self._look, name="watch", daemon=True)
            thread.start()
            stack.callback(thread.join, _JOIN_S)
            stack.callback(self._over.set)
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Stop watching."""
        self.memory.enter(Stage.OVER)
        self._stack.close()

    @contextlib.contextmanager
    def _handled(self) -> Iterator[None]:
        """Handle the signal, also in C: the outside watcher has the tracebacks then."""
        faulthandler.unregister(TRACE_SIGNAL)
        before = None
        if self._is_main:
            before = None if _handling else signal.signal(TRACE_SIGNAL, _raise_late)
            _handling.append(self)
        # Written in C, by whichever thread gets the signal, whichever keeps the lock.
        faulthandler.register(TRACE_SIGNAL, self.memory.trace_file(), all_threads=True, chain=True)
        try:
            yield
        finally:
            if self._is_main:
                _handling.remove(self)
            # One that is ours alone is watched to its end.
            if turns.own is None:
                faulthandler.unregister(TRACE_SIGNAL)
                if before is not None:
                    signal.signal(TRACE_SIGNAL, before)

    def _look(self) -> None:
        while not self._over.wait(_CHECK_S):
            if self._is_interrupted():
                self.memory.words[INTERRUPTED] = 1
            holder = self._hub.current
            # Signals are handled on the main thread only.
            if not self._is_main and holder is not None and self.memory.words[LATE]:
                self._note(holder, sys._current_frames().get(self._thread_id))
                thread, error = ctypes.c_ulong(self._thread_id), ctypes.py_object(Late)
                ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, error)

    def raise_late(self, frame: FrameType | None) -> None:
        """Raise in the midst of a participant that is late, unless it has come back meanwhile."""
        holder = self._hub.current
        if self.memory.words[LATE] and holder is not None and holder.is_running:
            self._note(holder, frame)
            raise Late(f"interrupted: {holder.late}")

    def _note(self, holder: HostedParticipant, frame: FrameType | None) -> None:
        """Note how a participant is late."""
        held_s, self.memory.words[LATE] = self.memory.words[LATE], 0.0
        holder.late = f"computing for {held_s:.1f} s, at {_where(frame)}"


def _raise_late(_number: int, frame: FrameType | None) -> None:
    for watch in tuple(_handling):
        watch.raise_late(frame)


@contextlib.contextmanager
def _watched_memory() -> Iterator[Turns]:
    """Yield a memory that another process watches: our parent, or else a child."""
    if turns.own is not None:
        yield turns.own
        return
    memory, owner = Turns(make_file()), os.getpid()
    command = [sys.executable, "-I", "-S", turn_watchdog.__file__, "3", str(owner)]
    actions = [
        (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
        (os.POSIX_SPAWN_DUP2, memory.file, 3),
    ]
    child = os.posix_spawn(sys.executable, command, os.environ, file_actions=actions, setsid=True)
    try:
        yield memory
    finally:
        if os.getpid() == owner:
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)  # no time-out: it has been killed
        memory.close()


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
