"""Ends a run in one process whose participant keeps Python's lock, from a process outside of it.

It needs nothing but the standard library, so that it is there as soon as the run is. It is the
parent of the command `stepbus run --in-process`, and a child of any other process that runs one:

    python turn_watchdog.py DESCRIPTOR PID
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))

from stepbus_orchestrator.processes.activity import activity_of
from stepbus_orchestrator.processes.turns import Row, Stage, Turns, Word

TICK_S = 0.1
_LONGEST_TICK_S = 0.25
"""One look counts for at most this long: a machine that slept is nobody's fault (P12.1)."""
_PATIENCE_S = 0.5
"""Behind its deadline, a participant is interrupted by the thread `watch` first [s]."""
_TRACE_S = 0.3
"""Between the signal that writes the tracebacks and the one that ends the process [s]."""
_MUTE_S = 1.0
"""The same, where a thread of a participant keeps Python's lock in the turn of nobody [s]."""
_LEAVE_S = 5.0
_LEFT_S = 0.2
"""How long a process may take to end that is known to have been left a thread too long [s]."""
_INTERRUPTED_S = 1.0
_IDLE_S = 0.5
"""How long it waits for another run of the same process [s]."""
_END_S = 5.0
_PAUSE_S = 0.005
_SWITCHES = 5
"""Times that a thread gives its processor away while the tracebacks are written: one that waits
for Python's lock asks for it 200 times a second."""
TRACE_SIGNAL = signal.SIGURG
"""Ignored by default, so that one too many does no harm."""


class TurnWatchdog:
    """Finds who keeps the thread, or Python's lock, for longer than its deadline.

    is_owner: the process does nothing but this run, so that whoever keeps the lock is of the run.
    is_interrupted: the user wants the run to end. held_s: how long the culprit has had it [s].
    culprit: its number; 0: unknown.
    """

    def __init__(self, turns: Turns, pid: int, *, is_owner: bool) -> None:
        self.is_interrupted = False
        self.held_s = 0.0
        self.culprit = 0
        self._turns = turns
        self._pid = pid
        self._is_owner = is_owner
        self._state = self._pulse = (-1.0, -1.0)
        self._held_s = self._mute_s = self._leaving_s = 0.0
        self._looked_at = time.monotonic()

    def is_late(self) -> bool:
        """Return whether the process has to be ended; to be asked every 0.1 s."""
        now = time.monotonic()
        elapsed_s = min(now - self._looked_at, _LONGEST_TICK_S)
        self._looked_at = now
        words = self._turns.words
        stage = words[Word.STAGE]
        if stage == Stage.LEAVING:
            self.culprit = int(words[Word.LEFT])
            self._leaving_s += elapsed_s
            return self._leaving_s > self._leave_s()
        turn = int(words[Word.TURN])
        state = words[Word.COUNT], words[Row.PUBLISHED + turn]
        pulse = words[Word.PULSE], stage
        self._held_s = self._held_s + elapsed_s if state == self._state else 0.0
        self._mute_s = self._mute_s + elapsed_s if pulse == self._pulse else 0.0
        self._state, self._pulse = state, pulse
        if stage == Stage.BEFORE or not self._is_overdue(turn):
            return False
        if not self._is_owner and activity_of(self._pid).is_stopped:
            # By Ctrl-Z, which does not reach us: that is no participant's.
            self._held_s = 0.0
            return False
        return True

    def _is_overdue(self, turn: int) -> bool:
        limit_s = self._turns.words[Row.LIMIT + turn]
        if self.is_interrupted:
            limit_s = min(limit_s, _INTERRUPTED_S)
        self.culprit, self.held_s = turn, self._held_s
        if turn:
            return self._held_s > limit_s + _PATIENCE_S
        if self._turns.words[Word.STAGE] == Stage.OVER:
            limit_s = _LEAVE_S
        self.held_s = self._mute_s
        return self._is_owner and self._mute_s > limit_s + _MUTE_S

    def _leave_s(self) -> float:
        """Return how long the process may take to end, with nothing more to do [s]."""
        words = self._turns.words
        if not words[Word.LEFT]:
            return _LEAVE_S
        return (
            _LEFT_S if words[Word.CODE] else min(words[Row.LIMIT + int(words[Word.LEFT])], _LEAVE_S)
        )

    def trace(self) -> bool:
        """Interrupt the process, which writes its tracebacks; return whether that was of no use."""
        self._turns.words[Word.LATE] = self.held_s
        before, switches = self._progress(), self._switches()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._pid, TRACE_SIGNAL)
        time.sleep(_TRACE_S)
        others = self._turns.with_threads()
        if others and (self._switches() - switches > _SWITCHES or not self.culprit):
            # Whose turn it is waits for Python's lock itself.
            self.culprit = others[0]
        return self._progress() == before

    def _progress(self) -> tuple[float, float]:
        return self._turns.words[Word.STAGE], self._turns.words[Word.COUNT]

    def _switches(self) -> int:
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{self._pid}/status").read_text().splitlines():
                if line.startswith("voluntary_ctxt_switches"):
                    return int(line.split()[1])
        return 0


def report(turns: Turns, pid: int, culprit: int, how: str, path: Sequence[str] = ()) -> int:
    """Write what a process that was ended cannot; return its exit code.

    how: `late` or `interrupted` and for how long [s], `signal` or `exit` and its number. path:
    where packages are.
    """
    with contextlib.suppress(OSError):
        os.set_inheritable(turns.file, True)
    command = [sys.executable, "-P", "-m", "stepbus_orchestrator.cli.post_mortem"]
    words = [str(turns.file), str(pid), str(culprit), how]
    paths = os.pathsep.join([*path, os.environ.get("PYTHONPATH", "")]).strip(os.pathsep)
    environment = {**os.environ, "PYTHONPATH": paths} if paths else None
    # no time-out: it copies a recording, which takes what its size takes; Ctrl-C ends it.
    return subprocess.call([*command, *words], pass_fds=[turns.file], env=environment)


def watch(turns: Turns, pid: int) -> None:
    """Watch a process that is not ours alone, our parent, for as long as it runs something."""
    watchdog, idle_s = TurnWatchdog(turns, pid, is_owner=False), 0.0
    while os.getppid() == pid and not _is_idle(turns, idle_s):
        if watchdog.is_late() and watchdog.trace():
            os.kill(pid, signal.SIGKILL)
            _await_end(pid)
            path = turns.read().get("path", [])
            report(turns, pid, watchdog.culprit, f"late {watchdog.held_s:.1f}", path)
            return
        idle_s = idle_s + TICK_S if turns.words[Word.STAGE] == Stage.OVER else 0.0
        time.sleep(TICK_S)


def _await_end(pid: int) -> None:
    """Wait for the end of our parent, which still writes its recording."""
    give_up = time.monotonic() + _END_S
    while os.getppid() == pid and time.monotonic() < give_up:
        time.sleep(_PAUSE_S)


def _is_idle(turns: Turns, idle_s: float) -> bool:
    """Return whether there is nothing to watch, and the process knows that nobody does."""
    if idle_s < _IDLE_S:
        return False
    turns.words[Word.GONE] = 1
    if turns.words[Word.STAGE] == Stage.OVER:
        return True
    # The next run has begun meanwhile.
    turns.words[Word.GONE] = 0
    return False


def _main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    # The folder in which it was started may be somebody's to remove.
    os.chdir("/")
    file, pid = map(int, sys.argv[1:])
    watch(Turns(file), pid)


if __name__ == "__main__":
    _main()
