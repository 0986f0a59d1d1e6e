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
from collections.abc import Mapping

from stepbus_orchestrator.processes import turns
from stepbus_orchestrator.processes.activity import children
from stepbus_orchestrator.processes.turn_watchdog import TICK_S, TurnWatchdog, report
from stepbus_orchestrator.processes.turns import Stage, Turns, Word

from .signals import SIGNALS

_INTERNAL = 1
_VARIABLE = "STEPBUS_TURNS"
"""Set by the parent for its child alone, which takes it away at once."""
_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_ORPHANS_S = 2.0
"""How long killed processes may take to go; one in the middle of a disk access takes long [s]."""
_PAUSE_S = 0.005
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
    turns.own = Turns(int(file))
    threading.Thread(target=_beat, args=(turns.own,), name="pulse", daemon=True).start()
    return True


def _beat(memory: Turns) -> None:
    """Show that Python's lock is to be had, for as long as this process lives."""
    while True:
        memory.words[Word.PULSE] += 1
        time.sleep(TICK_S)


def settle(code: int) -> None:
    """Tell the parent that nothing is left to do, but to end with this code."""
    if turns.own is not None:
        turns.own.enter(Stage.LEAVING, code)


def supervise(environment: Mapping[str, str]) -> int:
    """Start this command again, with a few more variables, as our child; return its exit code."""
    # Those that are ignored, as `nohup` does, stay ignored.
    signals = {number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN}
    signal.pthread_sigmask(signal.SIG_BLOCK, {*signals, signal.SIGCHLD})
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    try:
        file = turns.make_file()
        pid = _start_again(file, environment, signals)
    except OSError as exc:
        sys.stderr.write(
            f"stepbus: this command needs a process more: {exc.strerror} (ulimit -u, ulimit -f)\n"
        )
        return _INTERNAL
    return _Supervisor(Turns(file), pid).work(signals)


def _start_again(file: int, environment: Mapping[str, str], signals: set[signal.Signals]) -> int:
    os.set_inheritable(file, True)
    return os.posix_spawn(
        sys.executable,
        [sys.executable, *sys.orig_argv[1:]],
        {**os.environ, **environment, _VARIABLE: f"{file} {os.getpid()}"},
        # It has no handlers yet: signals wait until it has.
        setsigmask=signals,
    )


class _Supervisor:
    def __init__(self, memory: Turns, pid: int) -> None:
        self._turns = memory
        self._pid = pid
        self._watchdog = TurnWatchdog(memory, pid, is_owner=True)
        self._status: int | None = None
        self._late = ""

    def work(self, signals: set[signal.Signals]) -> int:
        while self._status is None:
            self._pass_on(signal.sigtimedwait({*signals, signal.SIGCHLD}, TICK_S))
            self._reap()
            is_running = self._status is None and not self._late
            if is_running and self._watchdog.is_late() and self._watchdog.trace():
                kind = "interrupted" if self._watchdog.is_interrupted else "late"
                self._late = f"{kind} {self._watchdog.held_s:.1f}"
                os.kill(self._pid, signal.SIGKILL)
        self._end_orphans()
        # From here on, Ctrl-C ends it at once.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, signals)
        return self._code(os.waitstatus_to_exitcode(self._status))

    def _pass_on(self, info: signal.struct_siginfo | None) -> None:
        if info is None or info.si_signo == signal.SIGCHLD:
            return
        self._watchdog.is_interrupted = True
        if info.si_code != _FROM_KERNEL:
            os.kill(self._pid, info.si_signo)

    def _reap(self) -> None:
        """Take the exit codes of our child, and of what it has left to us."""
        with contextlib.suppress(ChildProcessError):
            while True:
                pid, status = os.waitpid(-1, os.WNOHANG)
                if pid == self._pid:
                    self._status = status
                if not pid:
                    return

    def _end_orphans(self) -> None:
        """Kill what is left in our session; a process that has made its own means to stay."""
        give_up = time.monotonic() + _ORPHANS_S
        while time.monotonic() < give_up:
            self._reap()
            pids = [pid for pid in children(os.getpid()) if os.getsid(pid) == os.getsid(0)]
            if not pids:
                return
            for pid in pids:
                os.kill(pid, signal.SIGKILL)
            time.sleep(_PAUSE_S)

    def _code(self, code: int) -> int:
        words = self._turns.words
        stage, turn = words[Word.STAGE], int(words[Word.TURN])
        if self._late and stage == Stage.LEAVING and words[Word.CODE]:
            return int(words[Word.CODE])
        if self._late:
            return report(self._turns, self._pid, self._watchdog.culprit, self._late)
        if stage == Stage.RUNNING and turn:
            how = f"signal {-code}" if code < 0 else f"exit {code}"
            return report(self._turns, self._pid, turn, how)
        if code < 0:
            _die_of(-code)
        return code


def _die_of(number: int) -> None:
    """End as our child has ended, without a second core dump."""
    ctypes.CDLL(None).prctl(4, 0)
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
    os.kill(os.getpid(), number)
