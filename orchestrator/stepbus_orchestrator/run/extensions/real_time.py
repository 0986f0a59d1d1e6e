"""Real time: steps begin on the grid of the wall clock, and who is late is counted.

It only chooses when a trigger is sent: inputs are fixed by their step numbers, so it changes no
result.
"""

import dataclasses
import time
from array import array
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.errors import StepTimeout
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.failures import at
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.reports import Lateness
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import Clock

if TYPE_CHECKING:
    from stepbus_orchestrator.run.run import Run

_BOUNDS_US = (100, 200, 500, 1_000, 2_000, 5_000, 10_000, 100_000)


class RealTime(RunExtension):
    """Step k begins `k · step / factor` after the first, without drift.

    step_ns: length of a step [ns]. factor: 2 is twice as fast as real time. clock: until
    it has a run.
    """

    def __init__(self, step_ns: int, factor: float, clock: Clock = time) -> None:
        self._period_ns = step_ns / Fraction(factor).limit_denominator(1_000_000)
        self.factor = factor
        self._clock = clock
        self._origin_ns: int | None = None
        self._lateness_ns = array("q")
        self._holders: set[str] = set()
        self._late: dict[str, int] = {}

    def prepare(self, scenario: Scenario) -> Scenario:
        """Let each step begin when all have finished the one before, and its time has come."""
        return dataclasses.replace(scenario, window=1, batch=1)

    def attach(self, run: "Run") -> None:
        """Go by the clock of the run."""
        super().attach(run)
        self._clock = run.clock

    def limit(self, released: int) -> int:
        """Return the first step whose time has not come."""
        others = (gate(released) for gate in self.run.extensions.gates if gate != self.limit)
        self.follow(self.run.state, others=min(others, default=FAR))
        return self.due()

    def due(self) -> int:
        """Return the first step whose time has not come."""
        return int((self._clock.monotonic_ns() - self._origin()) // self._period_ns) + 1

    def wait_s(self, released: int, longest_s: float) -> float:
        """Return how long to wait for messages, at most until the next step is due [s]."""
        left_s = (self._due_ns(released) - self._clock.monotonic_ns()) * 1e-9
        return min(left_s, longest_s) if left_s > 0 else longest_s

    def follow(self, state: RunState, *, others: int) -> None:
        """Record who holds the next step past its time; others: the limit of all other gates."""
        released, now = state.released, self._clock.monotonic_ns()
        if now < self._due_ns(released):
            return
        if state.barrier.step_limit <= released:
            self._holders.update(state.barrier.holders())
        elif others <= released:
            # A pause or a call holds the run: the grid starts anew behind it.
            self._origin_ns = self._origin() + now - self._due_ns(released)

    def released(self, first: int, limit: int) -> None:
        """Record how late the steps begin."""
        self.began(self.run.state, first, limit)

    def began(self, state: RunState, first: int, limit: int) -> None:
        """Record that the steps from `first` to `limit` begin now.

        Raises StepTimeout where a participant was late that may not be.
        """
        now = self._clock.monotonic_ns()
        for step in range(first, limit):
            self._lateness_ns.append(max(0, now - self._due_ns(step)))
        late, self._holders = sorted(self._holders), set()
        for name in late:
            self._late[name] = self._late.get(name, 0) + 1
        self._check(state, first, late)

    def _check(self, state: RunState, step: int, late: Iterable[str]) -> None:
        for name in late:
            participant = state.participants[name]
            if participant.spec.real_time and participant.spec.on_late == "fail":
                raise StepTimeout(
                    f"{at(step - 1, state.scenario.step_ns)}: {participant.who()} was "
                    f"{self._lateness_ns[-1] * 1e-6:.3f} ms late for real time "
                    f"(participants.{name}.on_late); {participant.where_it_prints()}",
                    participant=name,
                    step=step - 1,
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

    def _origin(self) -> int:
        if self._origin_ns is None:
            self._origin_ns = self._clock.monotonic_ns()
        return self._origin_ns

    def _due_ns(self, step: int) -> int:
        return self._origin() + int(step * self._period_ns)
