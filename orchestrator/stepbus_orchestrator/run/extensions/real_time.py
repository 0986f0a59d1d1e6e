"""Holds steps by the wall clock: at a speed, or in real time, which counts late participants.

It only chooses when a trigger is sent: inputs are fixed by their step numbers, so it changes no
result.
"""

import dataclasses
from array import array
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from stepbus_orchestrator.errors import StepTimeout
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.reports import Lateness
from stepbus_orchestrator.scenario.model import Scenario

_BOUNDS_US = (100, 200, 500, 1_000, 2_000, 5_000, 10_000, 100_000)


_BEHIND_NS = Fraction(100_000_000)
"""A run that is further behind starts its grid anew: after a pause it does not hurry."""


class Speed(RunExtension):
    """Makes a run as slow as the user likes: it holds each step until its time by the wall clock.

    step_ns: length of a step [ns]. factor: 2: twice as fast as real time; None: as fast as it can.
    """

    factor: float | None = None

    def __init__(self, step_ns: int) -> None:
        self._step_ns = step_ns
        self._period_ns = Fraction(0)
        self._origin_ns = 0

    def attach(self, run: RunView) -> None:
        """Go by the clock of the run."""
        super().attach(run)
        self._now_ns = run.clock.monotonic_ns

    def set(self, factor: float | None, released: int) -> None:
        """Go so many times as fast as real time; None: as fast as possible.

        released: the step that begins now; those below it have been released.
        """
        self.factor, period_ns = factor, Fraction(0)
        if factor is not None:
            period_ns = self._step_ns / Fraction(factor).limit_denominator(1_000_000)
        self._period_ns, self._origin_ns = period_ns, self._now_ns() - int(released * period_ns)

    def due_ns(self, step: int) -> int:
        """Return when a step begins, by the clock of the run [ns]."""
        return self._origin_ns + int(step * self._period_ns)

    def limit(self, released: int) -> int:
        """Return the first step whose time has not come."""
        if not self._period_ns:
            return FAR
        if self._now_ns() - self.due_ns(released) >= max(self._period_ns, _BEHIND_NS):
            self.set(self.factor, released)
        return self._first_held()

    def _first_held(self) -> int:
        return int((self._now_ns() - self._origin_ns) // self._period_ns) + 1

    def wait_s(self, released: int, longest_s: float) -> float | None:
        """Return how long to wait for messages, at most until the next step is due [s]."""
        if not self._period_ns:
            return None
        left_s = (self.due_ns(released) - self._now_ns()) * 1e-9
        return min(left_s, longest_s) if left_s > 0 else longest_s


class RealTime(Speed):
    """Step k begins `k · step / factor` after the first, without drift.

    step_ns: length of a step [ns]. factor: 2 is twice as fast as real time.
    """

    factor: float

    def __init__(self, step_ns: int, factor: float) -> None:
        super().__init__(step_ns)
        self.factor = factor
        self._lateness_ns = array("q")
        self._holders: set[str] = set()
        self._late: dict[str, int] = {}

    def prepare(self, scenario: Scenario) -> Scenario:
        """Begin each step when all have finished the one before, and its time has come."""
        return dataclasses.replace(scenario, window=1, batch=1)

    def limit(self, released: int) -> int:
        """Return the first step whose time has not come; note how late the others begin.

        Raises StepTimeout where a participant was late that may not be.
        """
        if not self._period_ns:
            self.set(self.factor, released)
        overdue_ns = self._now_ns() - self.due_ns(released)
        barrier = self.run.state.barrier
        others = min((g(released) for g in self.run.gates if g != self.limit), default=FAR)
        if overdue_ns >= 0 and barrier.step_limit <= released:
            self._holders.update(barrier.holders())
        elif overdue_ns >= 0 and others <= released:
            # A pause or a call holds the run: the grid starts anew after it.
            self._origin_ns += overdue_ns
        due = self._first_held()
        self._begin(max(released, min(due, others, barrier.step_limit)))
        return due

    def _begin(self, limit: int) -> None:
        """Record how late the further steps below `limit` begin."""
        first, now = len(self._lateness_ns), self._now_ns()
        if limit <= first:
            return
        for step in range(first, limit):
            self._lateness_ns.append(max(0, now - self.due_ns(step)))
        late, self._holders = sorted(self._holders), set()
        for name in late:
            self._late[name] = self._late.get(name, 0) + 1
        for name in late:
            participant = self.run.state.participants[name]
            if participant.spec.real_time and participant.spec.on_late == "fail":
                raise self.run.state.failure(
                    StepTimeout,
                    participant,
                    first - 1,
                    f"was {self._lateness_ns[-1] * 1e-6:.3f} ms late for real time "
                    f"(participants.{name}.on_late); {participant.where_it_prints()}",
                )

    def result(self) -> Mapping[str, Any]:
        """Return how late the steps were."""
        return {"real_time": self.lateness()}

    def lateness(self) -> Lateness | None:
        """Return how late the steps were; None before the first."""
        sorted_ns = sorted(self._lateness_ns)
        if not sorted_ns:
            return None
        last_ns = self._lateness_ns[-1]
        planned_ns = len(sorted_ns) * self._period_ns
        histogram = dict.fromkeys([*map(str, _BOUNDS_US), "more"], 0)
        for value in sorted_ns:
            bound = next((str(us) for us in _BOUNDS_US if value <= us * 1000), "more")
            histogram[bound] += 1
        return Lateness(
            factor=self.factor,
            steps=len(sorted_ns),
            p50_us=sorted_ns[len(sorted_ns) // 2] * 1e-3,
            p99_us=sorted_ns[len(sorted_ns) * 99 // 100] * 1e-3,
            max_us=sorted_ns[-1] * 1e-3,
            histogram=histogram,
            late=self._late,
            kept=float(planned_ns / (planned_ns + last_ns)),
            behind_s=last_ns * 1e-9,
        )
