"""Lets participants that wait for each other share a core, where that makes the run faster.

In a chain, one participant works while all others sleep. The kernel wakes each on a core that is
idle, which takes several times as long as all that a small step computes. On one core, the next one
goes on where the last one stopped. What is faster here and now is measured, again and again; it
changes no result.
"""

from collections.abc import Generator, Iterator
from itertools import chain, repeat
from typing import TYPE_CHECKING

from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.scenario.model import Scenario

if TYPE_CHECKING:
    from stepbus_orchestrator.run.run import Run

_TRIAL_S = 0.05
_HOLD_S = (0.5, 1.0, 2.0, 4.0)
"""How long what was faster is kept; the longer, the more often it has been tried [s]."""
_MOST_TRIALS = 6
_ENOUGH_STEPS = 100
_LEAST_RATE = 200.0
"""Below, the steps are what takes the time, and may use all cores [steps/s]."""
_GAIN = 1.05


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
    """Tries, while a run is stepping, whether its cycles are faster on one core."""

    def attach(self, run: "Run") -> None:
        """Find out which participants may share a core."""
        super().attach(run)
        self._names = in_cycles(run.session.scenario)
        self._processes: dict[str, Process] = {}
        self._plan = self._trials()
        self._due_s = 0.0
        self._is_together = False

    def started(self, participant: ParticipantState) -> None:
        """Take a process; one that replaces another takes its place."""
        if participant.name in self._names:
            self._processes[participant.name] = participant.process

    def turn(self) -> None:
        """Go on with the plan, when it is time to."""
        now = self.run.clock.monotonic()
        if now >= self._due_s and self.run.state.phase.is_stepping:
            self._due_s = now + next(self._plan, float("inf"))

    def stopping(self) -> None:
        """Let all participants end wherever they like."""
        self._apart()
        self._due_s = float("inf")

    def _trials(self) -> Iterator[float]:
        """Yield how long to leave everything as it is [s]."""
        for hold_s in chain(_HOLD_S, repeat(_HOLD_S[-1])):
            apart = yield from self._rate()
            if apart >= _LEAST_RATE:
                if not self._together():
                    return
                together = yield from self._rate()
                if together < _GAIN * apart:
                    self._apart()
            yield hold_s
            self._apart()

    def _rate(self) -> Generator[float, None, float]:
        """Yield for how long to try; return how many steps a second were completed meanwhile."""
        barrier, clock = self.run.state.barrier, self.run.clock
        began, first = clock.monotonic(), barrier.completed
        for _ in range(_MOST_TRIALS):
            yield _TRIAL_S
            if barrier.completed - first >= _ENOUGH_STEPS:
                break
        return (barrier.completed - first) / (clock.monotonic() - began)

    def _together(self) -> bool:
        """Keep all on the core that one of them uses; return whether they can be."""
        cores = [process.core() for process in self._processes.values()]
        if None in cores or len(cores) < len(self._names):
            return False
        for process in self._processes.values():
            process.keep_on(cores[0])
        self._is_together = True
        return True

    def _apart(self) -> None:
        if self._is_together:
            self._is_together = False
            for process in self._processes.values():
                process.keep_on(None)
