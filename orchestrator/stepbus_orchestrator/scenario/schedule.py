"""Who works when: the order of participants within a step, and what each input waits for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from stepbus_schemas import due_step

from .model import InputSpec, ParticipantSpec, Scenario


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """The schedule of a scenario.

    order: the participants within a step, each after those whose output of the same step it
    reads; where that leaves a choice, as in the scenario. every: participant → it fires at
    multiples of this [steps]. first: those that publish before they read. steps: length of the
    run; none: until something ends it.
    """

    order: tuple[str, ...]
    every: Mapping[str, int]
    first: frozenset[str]
    steps: int | None

    @classmethod
    def of(cls, scenario: Scenario) -> Schedule:
        """Return the schedule of a scenario without algebraic loops."""
        order, _ = _sorted(scenario.participants)
        return cls(
            order=tuple(order),
            every={spec.name: spec.every for spec in scenario.participants},
            first=frozenset(s.name for s in scenario.participants if s.publishes == "first"),
            steps=scenario.steps,
        )

    def fires(self, name: str, step: int) -> bool:
        """Return whether a participant reads, computes and publishes at a step."""
        inside = step >= 0 and (self.steps is None or step < self.steps)
        return inside and step % self.every[name] == 0

    def closing(self, name: str, end: int | None = None) -> bool:
        """Return whether a participant publishes once more after the last step.

        One that publishes first computes, in its last step, a state that belongs to the step
        after it. end: number of steps after which the run ends; default: as in the scenario.
        """
        end = self.steps if end is None else end
        return end is not None and name in self.first and end % self.every[name] == 0

    def publishing(self, step: int) -> tuple[str, ...]:
        """Return who publishes at a step, in schedule order; at `steps`: those that close."""
        closes = step == self.steps
        return tuple(
            name for name in self.order if self.fires(name, step) or (closes and self.closing(name))
        )

    def due_step(self, source: InputSpec, step: int) -> int | None:
        """Return which step's output an input takes at a step.

        It is the newest firing of the source at or before `step − delay`; none while absent.
        """
        due = due_step(step, source.delay, self.every[source.source])
        return due if due >= 0 else None

    def text(self, steps: int) -> str:
        """Return the first steps as text: `plant@0 mission@0 controller@0 plant@1 …`.

        When all steps of the run are shown, those who publish once more close it: `plant@2000`.
        """
        whole = self.steps is not None and steps >= self.steps
        shown = range(self.steps + 1 if whole and self.steps is not None else steps)
        return " ".join(f"{name}@{step}" for step in shown for name in self.publishing(step))


def find_loops(participants: Iterable[ParticipantSpec]) -> list[tuple[str, ...]]:
    """Return algebraic loops, each as (`controller`, `mission`, `controller`) along the data.

    A loop of undelayed inputs can never start unless one in it publishes before it reads.
    All participants fire at step 0, so different rates do not break a loop either.
    """
    return _sorted(participants)[1]


def _sorted(participants: Iterable[ParticipantSpec]) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return the topological order, and the loops that had to be left out of it."""
    left = _predecessors(list(participants))
    order: list[str] = []
    loops: list[tuple[str, ...]] = []
    while left:
        free = next((name for name, before in left.items() if not before & left.keys()), None)
        if free is None:
            loop = _loop(left)
            loops.append(loop)
            left = {name: before for name, before in left.items() if name not in loop}
        else:
            order.append(free)
            del left[free]
    return order, loops


def _predecessors(participants: list[ParticipantSpec]) -> dict[str, set[str]]:
    """Return who has to publish a step before each can: none for those that publish first."""
    names = {spec.name for spec in participants}
    return {
        spec.name: {
            item.source
            for item in spec.inputs.values()
            if item.delay == 0 and spec.publishes == "last" and item.source in names
        }
        for spec in participants
    }


def _loop(left: Mapping[str, set[str]]) -> tuple[str, ...]:
    """Return a loop among participants each of which waits for another of them."""
    names = list(left)
    path = [names[0]]
    while True:
        before = next(name for name in names if name in left[path[-1]])
        if before in path:
            loop = path[path.index(before) :][::-1]
            start = loop.index(min(loop, key=names.index))
            loop = loop[start:] + loop[:start]
            return (*loop, loop[0])
        path.append(before)
