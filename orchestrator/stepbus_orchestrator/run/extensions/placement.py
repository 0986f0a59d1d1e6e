"""Lets participants that wait for each other share a core, where that makes the run faster.

In a chain, one participant works while all others sleep. The kernel wakes each on a core that is
idle, which takes several times as long as all that a small step computes. On one core, the next one
goes on where the last one stopped. And where a message wakes its reader before its sender has sent
the others, these come late: so each has to wait until the sender sleeps. What is faster here
and now is measured, again and again; it changes no result.
"""

import contextlib
import os
from collections.abc import Generator, Iterator
from itertools import chain, repeat
from pathlib import Path

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.scenario.model import Scenario

_TRIAL_S = 0.08
_HOLD_S = (0.5, 1.0, 2.0, 4.0)
"""How long what was faster is kept; the longer, the more often it has been tried [s]."""
_LONGEST_S = 0.3
_LEAST_RATE = 200.0
"""Below, the steps are what takes the time, and may use all cores [steps/s]."""
_GAIN = 1.08
_CORE = 36
"""Where /proc/<pid>/stat has the core, after the name (proc_pid_stat(5))."""
_COMMON = (os.SCHED_OTHER, os.SCHED_BATCH)
"""Policies of threads that may be moved; others are for real time, for example (sched(7))."""


def in_cycles(scenario: Scenario) -> list[str]:
    """Return the participants that wait for themselves, by way of others."""
    reads = {
        spec.name: {item.source for item in spec.inputs.values()} for spec in scenario.participants
    }
    return [name for name in reads if name in _upstream(reads, name)]


def _upstream(reads: dict[str, set[str]], name: str) -> set[str]:
    found: set[str] = set()
    left = set(reads[name])
    while left:
        found |= left
        left = set().union(*(reads[source] for source in left)) - found
    return found


class Placement(RunExtension):
    """Tries, while a run is stepping, whether it is faster with its processes placed."""

    def attach(self, run: RunView) -> None:
        """Find out which participants may share a core."""
        super().attach(run)
        self._cycles = in_cycles(run.session.scenario)
        self._pids: dict[str, int] = {}
        self._is_placed = False
        self._plan = self._trials()
        self._due_s = 0.0

    def started(self, participant: ParticipantState) -> None:
        """Take a process; a process that replaces another takes its place."""
        if isinstance(participant.process, Child):
            self._pids[participant.name] = participant.process.pid
        elif participant.spec.folder:
            # It is on another host: here, the relay takes its place in the chain.
            self._pids[participant.name] = self.run.strategy.relay

    def turn(self) -> None:
        """Go on with the plan, when it is time to."""
        if self.run.is_timed:
            # The clock says when a step begins; a trial would only make some late.
            self._put(is_placed=False)
            return
        now = self.run.clock.monotonic()
        if now >= self._due_s and self.run.state.phase.is_stepping:
            self._due_s = now + next(self._plan, FAR)

    def stopping(self) -> None:
        """Let all end wherever they like, and leave this process as it was."""
        self._put(is_placed=False)
        self._due_s = FAR

    close = stopping

    def _trials(self) -> Iterator[float]:
        """Yield how long to leave everything as it is [s]."""
        ours = os.sched_getaffinity(0)
        are_ours = len(self._pids) == len(self.run.state.participants)
        if len(ours) < 2 or not are_ours or not all(_is_free(p) for p in self._pids.values()):
            return
        for hold_s in chain(_HOLD_S, repeat(_HOLD_S[-1])):
            before = yield from self._rate()
            if before >= _LEAST_RATE:
                self._put(is_placed=not self._is_placed)
                rate = yield from self._rate()
                if rate <= _GAIN * before:
                    self._put(is_placed=not self._is_placed)
            yield hold_s

    def _rate(self) -> Generator[float, None, float]:
        """Yield for how long to try; return how many steps a second were completed meanwhile."""
        began, first = yield from self._news()
        yield _TRIAL_S
        ended, last = yield from self._news()
        return (last - first) / (ended - began)

    def _news(self) -> Generator[float, None, tuple[float, int]]:
        """Yield until further steps are complete, many of which are reported at once."""
        clock, barrier = self.run.clock, self.run.state.barrier
        began, first = clock.monotonic(), barrier.completed
        while barrier.completed == first and clock.monotonic() < began + _LONGEST_S:
            yield 0.0
        return clock.monotonic(), barrier.completed

    def _put(self, *, is_placed: bool) -> None:
        if is_placed == self._is_placed:
            return
        self._is_placed = is_placed
        ours = os.sched_getaffinity(0)
        shared = _core_of(self._pids[self._cycles[0]]) if is_placed and self._cycles else ours
        # Last those that share: a relay stands for several participants.
        for name, pid in sorted(self._pids.items(), key=lambda row: row[0] in self._cycles):
            place(pid, shared if name in self._cycles else ours, waits=is_placed)
        place(os.getpid(), ours, waits=is_placed)


def _is_free(pid: int) -> bool:
    """Return whether a process has chosen neither cores nor a policy."""
    with contextlib.suppress(OSError):
        is_everywhere = os.sched_getaffinity(pid) == os.sched_getaffinity(0)
        return is_everywhere and os.sched_getscheduler(pid) in _COMMON
    return False


def _core_of(pid: int) -> set[int]:
    """Return the core that a process has run on last; all of ours where it has ended."""
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return {int(fields[_CORE])}
    return os.sched_getaffinity(0)


def place(pid: int, cores: set[int], *, waits: bool) -> None:
    """Keep all threads of a process on some cores; what it starts later runs as they do.

    waits: a thread that wakes up waits until the thread that runs there sleeps, or its time is over
    (SCHED_BATCH of sched(7)).
    """
    policy = os.SCHED_BATCH if waits else os.SCHED_OTHER
    # Each thread may have ended meanwhile, and so may the process.
    with contextlib.suppress(OSError):
        for thread in map(int, (path.name for path in Path(f"/proc/{pid}/task").iterdir())):
            if os.sched_getscheduler(thread) in _COMMON:
                os.sched_setaffinity(thread, cores)
                os.sched_setscheduler(thread, policy, os.sched_param(0))
