"""Which steps are complete, who holds the oldest, and how far the run may go."""

from collections.abc import Callable, Iterable
from operator import add

from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.ports import InputSpec
from stepbus_schemas import due_step

FAR = 1 << 62
"""Beyond the last step of any run."""


Gate = Callable[[int], int]
"""Returns the first step that must not be released yet, or FAR; gets how far steps are released."""


class Barrier:
    """Counts the outputs of every participant.

    window: steps that may be in flight. reported: newest step each participant has reported;
    negative before its first. count: how many outputs that were.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.window = scenario.window
        self._steps = scenario.steps
        self._every = {spec.name: spec.every for spec in scenario.participants}
        self._first = {s.name for s in scenario.participants if s.publishes == "first"}
        self._inputs = {spec.name: list(spec.inputs.values()) for spec in scenario.participants}
        self.reported = {name: -every for name, every in self._every.items()}
        self.count = 0
        self._completed: int | None = None
        self._first_step = dict.fromkeys(self._every, 0)

    def start_at(self, name: str, step: int) -> None:
        """Start a participant at a step: all below it is known."""
        self.reported[name] = step - self._every[name]
        self._first_step[name] = step
        self._completed = None

    @property
    def has_all_started(self) -> bool:
        """Return whether every participant has reported its first step."""
        return all(step >= self._first_step[name] for name, step in self.reported.items())

    def report(self, name: str, step: int) -> bool:
        """Count the outputs of a step; return whether it is the next one (P7.1)."""
        if step != self.reported[name] + self._every[name]:
            return False
        self.advance(name, step, 1)
        return True

    def advance(self, name: str, step: int, count: int) -> None:
        """Count so many outputs, of which the newest is that of a step."""
        self.reported[name] = step
        self.count += count
        self._completed = None

    @property
    def completed(self) -> int:
        """Return how many steps are complete: every output due in them has been reported."""
        if self._completed is None:
            done: int = min(map(add, self.reported.values(), self._every.values()))
            self._completed = done if self._steps is None else min(done, self._steps)
        return self._completed

    def last(self) -> list[str]:
        """Return the participants without whose outputs no further step is complete."""
        done = min(map(add, self.reported.values(), self._every.values()))
        every = self._every
        return [name for name, step in self.reported.items() if step + every[name] == done]

    @property
    def step_limit(self) -> int:
        """Return the newest trigger: steps below it may be worked on (P5.5)."""
        ahead = self.completed + self.window
        return ahead if self._steps is None else min(ahead, self._steps)

    def next_step(self, name: str) -> int:
        """Return the step whose output a participant owes next."""
        return self.reported[name] + self._every[name]

    def holders(self) -> list[str]:
        """Return the participants that hold the oldest incomplete step (P12.2).

        They owe an output although all they need for it has been reported; one that waits for
        them is not among them.
        """
        step = self.completed
        if step == self._steps:
            return []
        owing = [name for name in self.reported if self.next_step(name) <= step]
        return [name for name in owing if not self.missing(name)]

    def missing(self, name: str) -> list[str]:
        """Return the participants whose outputs are missing for its next output."""
        step = self.next_step(name)
        if name in self._first:
            # What it publishes next is the result of the step before (P5.3).
            step -= self._every[name]
        return [item.source for item in self._inputs[name] if not self._arrived(item, step)]

    def _arrived(self, item: InputSpec, step: int) -> bool:
        due = due_step(step, item.delay, self._every[item.source])
        return due < 0 or self.reported[item.source] >= due


def step_limit(barrier: Barrier, gates: Iterable[Gate], released: int) -> int:
    """Return how far participants may work; the trigger only ever grows (P5.2)."""
    limit = min([barrier.step_limit, *(gate(released) for gate in gates)])
    return max(limit, released)
