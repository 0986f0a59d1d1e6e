"""Lets participants that wait for each other share a core, where that makes the run faster.

In a chain, one participant works while all others sleep. The kernel wakes each on a core that is
idle, which takes several times as long as all that a small step computes. On one core, the next one
goes on where the last one stopped. And where a message wakes its reader before its sender has sent
the others, these come late: so each may have to wait until the sender sleeps. What is faster here
and now is measured, again and again; it changes no result.
"""

import os
from collections.abc import Generator, Iterator
from dataclasses import replace
from itertools import chain, repeat

from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.processes.place import Place, place_threads
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.scenario.model import Scenario

_TRIAL_S = 0.08
_HOLD_S = (0.5, 1.0, 2.0, 4.0)
"""How long what was faster is kept; the longer, the more often it has been tried [s]."""
_LONGEST_S = 0.3
_LEAST_RATE = 200.0
"""Below, the steps are what takes the time, and may use all cores [steps/s]."""
_GAIN = 1.08


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
    """Tries, while a run is stepping, which place of its processes makes it faster."""

    def attach(self, run: RunView) -> None:
        """Find out which participants may share a core."""
        super().attach(run)
        self._cycles = in_cycles(run.session.scenario)
        self._processes: dict[str, Process] = {}
        self._place = Place()
        self._plan = self._trials()
        self._due_s = 0.0

    def started(self, participant: ParticipantState) -> None:
        """Take a process; one that replaces another takes its place."""
        self._processes[participant.name] = participant.process

    def turn(self) -> None:
        """Go on with the plan, when it is time to."""
        if self.run.is_timed:
            # The clock says when a step begins; a trial would only make some late.
            self._put(Place())
            return
        now = self.run.clock.monotonic()
        if now >= self._due_s and self.run.state.phase.is_stepping:
            self._due_s = now + next(self._plan, float("inf"))

    def stopping(self) -> None:
        """Let all end wherever they like."""
        self._put(Place())
        self._due_s = float("inf")

    def close(self) -> None:
        """Leave this process as it was, also where a run has failed."""
        self._put(Place())

    def _trials(self) -> Iterator[float]:
        """Yield how long to leave everything as it is [s]."""
        if None in [process.core() for process in self._processes.values()]:
            return
        for hold_s in chain(_HOLD_S, repeat(_HOLD_S[-1])):
            best = yield from self._rate()
            for other in (self._elsewhere, self._otherwise):
                if best >= _LEAST_RATE:
                    kept = self._place
                    self._put(other())
                    rate = yield from self._rate()
                    if rate > _GAIN * best:
                        best = rate
                    else:
                        self._put(kept)
            yield hold_s

    def _elsewhere(self) -> Place:
        if self._place.core is not None or not self._cycles:
            return replace(self._place, core=None)
        return replace(self._place, core=self._processes[self._cycles[0]].core())

    def _otherwise(self) -> Place:
        return replace(self._place, yields=not self._place.yields)

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

    def _put(self, place: Place) -> None:
        if place == self._place:
            return
        self._place = place
        for name, process in self._processes.items():
            process.place(place if name in self._cycles else replace(place, core=None))
        place_threads(os.getpid(), replace(place, core=None))
