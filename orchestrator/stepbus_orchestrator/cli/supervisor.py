"""The parent of a command that runs participants in its own process, and outlives them.

Whatever one of them does to that process, the command ends in time, with the exit code that a
participant in a process of its own would have caused, and leaves no process behind.
"""

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Mapping

from stepbus_orchestrator.processes import reaper
from stepbus_orchestrator.processes.activity import children
from stepbus_orchestrator.run.inprocess import heartbeat
from stepbus_orchestrator.run.inprocess.heartbeat import (
    CODE,
    INTERRUPTED,
    PULSE,
    TICK_S,
    TURN,
    Heartbeat,
    Stage,
    Watcher,
)

from .interrupts import SIGNALS

_INTERNAL = 1
_VARIABLE = "STEPBUS_TURNS"
"""Set by the parent for its child alone, which takes it away at once."""
_PR_SET_PDEATHSIG = 1
_PR_SET_DUMPABLE = 4
_PR_SET_CHILD_SUBREAPER = 36
_FROM_KERNEL = 0x80
"""Code of a signal that the terminal has sent to all its processes, the child included."""


def adopt() -> bool:
    """Return whether a parent watches this process; from then on, it ends with it."""
    file, _, parent = os.environ.pop(_VARIABLE, "").partition(" ")
    if not file:
        return False
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent):
        os._exit(1)
    os.set_inheritable(int(file), False)
    heartbeat.own = Heartbeat(int(file))
    threading.Thread(target=_beat, args=(heartbeat.own,), name="pulse", daemon=True).start()
    return True


def _beat(memory: Heartbeat) -> None:
    """Show that Python's lock is to be had, for as long as this process lives."""
    while True:
        memory.words[PULSE] += 1
        time.sleep(TICK_S)


def settle(code: int) -> None:
    """Tell the parent that nothing is left to do, but to end with this code."""
    if heartbeat.own is not None:
        heartbeat.own.enter(Stage.LEAVING, code)


def supervise(environment: Mapping[str, str]) -> int:
    """Start this command again, with a few more variables, as our child; return its exit code."""
    # Those that are ignored, as `nohup` does, stay ignored.
    signals = {number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    try:
        memory = Heartbeat()
        os.set_inheritable(memory.file, True)
        pid = os.posix_spawn(
            sys.executable,
            [sys.executable, *sys.orig_argv[1:]],
            {**os.environ, **environment, _VARIABLE: f"{memory.file} {os.getpid()}"},
            # It has no handlers yet: signals wait until it has.
            setsigmask=signals,
        )
    except OSError as exc:
        sys.stderr.write(
            f"stepbus: cannot start a helper process: {exc.strerror} (ulimit -u, ulimit -f)\n"
        )
        return _INTERNAL
    watcher = Watcher(memory, pid, is_owner=True)
    is_killed = watcher.await_end(meanwhile=lambda: _pass_on(signals, memory, pid))
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])  # no time-out: it has ended
    reaper.end(_left)
    # What came before its end changes nothing; from here on, Ctrl-C ends this process at once.
    while signal.sigtimedwait(signals, 0) is not None:
        pass
    signal.pthread_sigmask(signal.SIG_UNBLOCK, signals)
    return _concluded(memory, pid, code, watcher if is_killed else None)


def _pass_on(signals: Iterable[int], memory: Heartbeat, pid: int) -> None:
    # With a time to wait, CPython returns rubbish where it is interrupted as that time ends.
    info = signal.sigtimedwait(signals, 0)
    if info is None:
        return
    memory.words[INTERRUPTED] = 1
    if info.si_code != _FROM_KERNEL:
        os.kill(pid, info.si_signo)


def _left() -> dict[int, str]:
    """Return the orphans of our session; a process that has made its own means to stay."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    return {pid: "" for pid in children(os.getpid()) if os.getsid(pid) == os.getsid(0)}


def _concluded(memory: Heartbeat, pid: int, code: int, killer: Watcher | None) -> int:
    """Return the exit code of the command. killer: has killed our late child."""
    if killer is not None and memory.stage is Stage.LEAVING and memory.words[CODE]:
        return int(memory.words[CODE])
    if killer is not None or (memory.stage.is_run and memory.words[TURN]):
        from stepbus_orchestrator.run.inprocess import post_mortem  # noqa: PLC0415

        from .terminal.output import write  # noqa: PLC0415

        code, text = post_mortem.conclude(memory, pid, killer=killer, code=code)
        write(sys.stderr, text)
        return code
    if code < 0:
        _die_of(-code)
    return code


def _die_of(number: int) -> None:
    """End as our child has ended, without a second core dump."""
    ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0)
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
    os.kill(os.getpid(), number)
