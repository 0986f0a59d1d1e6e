"""Ends a run in one process whose participant keeps the thread, from a process outside of it.

It needs nothing but the standard library, so that it is there as soon as the run is. Where the
command hosts participants, its parent does this; elsewhere, a child of the process that does:

    python turn_watchdog.py DESCRIPTOR PID
"""

import contextlib
import math
import os
import signal
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[3]))

from stepbus_orchestrator.processes.activity import activity_of
from stepbus_orchestrator.run.inprocess.turns import (
    INTERRUPTED,
    LATE,
    PUBLISHED,
    PULSE,
    TURN,
    TURNS,
    Kept,
    Stage,
    Turns,
)

TICK_S = 0.1
_LONGEST_TICK_S = 0.25
"""One look counts for at most this long: a machine that slept is no participant's fault (P12.1)."""
_PATIENCE_S = 0.5
"""How long a participant may take to end that has been interrupted at its deadline [s]."""
_MUTE_S = 1.0
"""The same, where a thread keeps Python's lock in no participant's turn [s]."""
_TRACE_S = 0.3
"""Between the signal that writes the tracebacks and the one that ends the process [s]."""
_LEAVE_S = 5.0
"""How long a process may take to end after its run [s]."""
_INTERRUPTED_S = 1.0
_END_S = 5.0
_PAUSE_S = 0.005
_SWITCHES = 5
"""Times that a thread gives its processor away while the tracebacks are written: one that waits
for Python's lock asks for it 200 times a second."""
TRACE_SIGNAL = signal.SIGURG
"""Ignored by default, so that one too many does no harm."""


class TurnWatchdog:
    """Finds the participant that keeps the thread, or Python's lock, beyond its deadline.

    is_owner: the process does nothing but this run, so that any thread that keeps the lock is of
    the run. kept: how long the culprit has had it.
    """

    def __init__(self, turns: Turns, pid: int, *, is_owner: bool) -> None:
        self.kept = Kept()
        self._turns = turns
        self._pid = pid
        self._is_owner = is_owner
        self._state: tuple[float, ...] = ()
        self._is_interrupted = False
        self._looked_at = time.monotonic()

    def is_late(self) -> bool:
        """Return whether the process has to be killed; to be asked every 0.1 s.

        A participant that is late is interrupted first.
        """
        now = time.monotonic()
        elapsed_s, self._looked_at = min(now - self._looked_at, _LONGEST_TICK_S), now
        stage, turn = self._turns.stage, int(self._turns.words[TURN])
        state = self._progress(stage, turn)
        if state != self._state:
            self._state, self._is_interrupted, self.kept.held_s = state, False, 0.0
            return False
        self.kept.held_s += elapsed_s
        is_watched = stage is not Stage.BEFORE and (self._is_owner or turn > 0)
        # To read the limits takes a while, and hardly any participant comes near them.
        if not is_watched or self.kept.held_s <= _LONGEST_TICK_S:
            return False
        limit_s = self._limit_s(stage, turn)
        if self.kept.held_s <= limit_s:
            return False
        self.kept.is_stopped = activity_of(self._pid).is_stopped
        if not self._is_owner and self.kept.is_stopped:
            # By Ctrl-Z, which does not reach us: that is no participant's.
            self.kept.held_s = 0.0
            return False
        if turn and not self._is_interrupted:
            self._is_interrupted = True
            self._interrupt()
            return False
        return self.kept.held_s > limit_s + (_PATIENCE_S if turn else 0.0) and self._is_stuck(turn)

    def _progress(self, stage: Stage, turn: int) -> tuple[float, ...]:
        """Return what changes as long as the process gets on."""
        words = self._turns.words
        if turn:
            return stage, words[TURNS], words[PUBLISHED + turn]
        return (stage,) if stage is Stage.LEAVING else (stage, words[PULSE])

    def _limit_s(self, stage: Stage, turn: int) -> float:
        words = self._turns.words
        rows: list[list[float]] = self._turns.will().get("limits", [])
        if stage.is_run:
            # In no participant's turn, it may be any of them.
            some = rows[turn - 1 : turn] or rows
            limit_s = max((row[stage - 1] for row in some), default=math.inf)
            limit_s = min(limit_s, _INTERRUPTED_S) if words[INTERRUPTED] else limit_s
            return limit_s if turn else limit_s + _MUTE_S
        return _LEAVE_S

    def _interrupt(self) -> None:
        """Make the process write its tracebacks, and raise in what the participant executes."""
        self._turns.words[LATE] = self.kept.held_s
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._pid, TRACE_SIGNAL)

    def _is_stuck(self, turn: int) -> bool:
        """Interrupt once more; return whether that was of no use."""
        before, switches = self._turns.words[TURNS], self._switches()
        self._interrupt()
        time.sleep(_TRACE_S)
        self.kept.is_waiting = not turn or self._switches() - switches > _SWITCHES
        return (self._turns.stage, self._turns.words[TURNS]) == (self._state[0], before)

    def _switches(self) -> int:
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{self._pid}/status").read_text().splitlines():
                if line.startswith("voluntary_ctxt_switches"):
                    return int(line.split()[1])
        return 0


def _watch(turns: Turns, pid: int) -> None:
    """Watch our parent, which is not ours alone, until it ends us."""
    watchdog = TurnWatchdog(turns, pid, is_owner=False)
    while os.getppid() == pid:
        if watchdog.is_late():
            os.kill(pid, signal.SIGKILL)
            give_up = time.monotonic() + _END_S
            while os.getppid() == pid and time.monotonic() < give_up:
                time.sleep(_PAUSE_S)
            sys.path[:] = turns.will()["path"]
            from stepbus_orchestrator.run.inprocess.post_mortem import conclude  # noqa: PLC0415

            _, text = conclude(turns, pid, kept=watchdog.kept)
            sys.stderr.write(text)
            return
        time.sleep(TICK_S)


if __name__ == "__main__":
    for _number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(_number, signal.SIG_IGN)
    # Another process may remove the folder in which it was started.
    os.chdir("/")
    _watch(Turns(int(sys.argv[1])), int(sys.argv[2]))
