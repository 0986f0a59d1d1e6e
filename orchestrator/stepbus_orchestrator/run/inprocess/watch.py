"""Interrupts a participant that keeps the thread past its deadline (P12).

A process outside of this one keeps the deadlines, since a participant that does not come back may
keep Python's lock. It sends a signal, whose handler names the line of code and raises there; where
that is of no use, it ends this process, see `heartbeat.py`.
"""

import contextlib
import faulthandler
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from stepbus_orchestrator.run.inprocess import heartbeat, watch_parent
from stepbus_orchestrator.run.inprocess.heartbeat import LATE, TRACE_SIGNAL, Heartbeat, Stage
from stepbus_orchestrator.run.inprocess.hub import Hub, Late

_handling: list[tuple[Hub, Heartbeat]] = []
"""Of the runs that go on; the first installs the handler, the last removes it."""


@contextlib.contextmanager
def watched(hub: Hub, given: Heartbeat | None) -> Iterator[Heartbeat]:
    """Watch the participants of a run, and yield the memory that shows who has the thread.

    given: a memory of `watched_memory`; None: it takes a new one.
    """
    made = watched_memory() if given is None else contextlib.nullcontext(given)
    with made as memory, _handled(hub, memory):
        try:
            yield memory
        finally:
            memory.enter(Stage.OVER)


@contextlib.contextmanager
def _handled(hub: Hub, memory: Heartbeat) -> Iterator[None]:
    """Handle the signal, also in C: the outside watcher has the tracebacks then."""
    faulthandler.unregister(TRACE_SIGNAL)
    if not _handling:
        signal.signal(TRACE_SIGNAL, _raise_late)
    row = (hub, memory)
    _handling.append(row)
    # Written in C, by whichever thread gets the signal, whichever keeps the lock.
    faulthandler.register(TRACE_SIGNAL, memory.file, all_threads=True, chain=True)
    try:
        yield
    finally:
        _handling.remove(row)
        # A process that is the run's alone is watched to its end.
        if heartbeat.own is None:
            faulthandler.unregister(TRACE_SIGNAL)
            if not _handling:
                signal.signal(TRACE_SIGNAL, signal.SIG_DFL)


def _raise_late(_number: int, frame: FrameType | None) -> None:
    """Raise in the midst of a participant that is late, unless it has come back meanwhile."""
    for hub, memory in tuple(_handling):
        holder = hub.current
        if memory.words[LATE] and holder is not None and holder.is_running:
            held_s, memory.words[LATE] = memory.words[LATE], 0.0
            holder.late = f"computing for {held_s:.1f} s, at {_where(frame)}"
            raise Late(f"interrupted: {holder.late}")


@contextlib.contextmanager
def watched_memory() -> Iterator[Heartbeat]:
    """Yield a memory for one run after the other; another process watches it.

    That is our parent, or else a child.
    """
    if heartbeat.own is not None:
        yield heartbeat.own
        return
    memory, owner = Heartbeat(), os.getpid()
    command = [sys.executable, "-I", "-S", watch_parent.__file__, "3", str(owner)]
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
