"""Who works when: the order of participants within a step, and what each input waits for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from stepbus_schemas import due_step

from .model import ParticipantSpec, Scenario
from .ports import InputSpec


@dataclass(frozen=True)
class Schedule:
    """The schedule of a scenario without algebraic loops."""

    scenario: Scenario

    @cached_property
    def order(self) -> tuple[str, ...]:
        """Return the participants within a step, each after those whose output of it it reads.

        Where that leaves a choice, they come as in the scenario.
        """
        return sort(self.scenario.participants)[0]

    def fires(self, name: str, step: int) -> bool:
        """Return whether a participant reads, computes and publishes at a step."""
        steps = self.scenario.steps
        is_inside = step >= 0 and (steps is None or step < steps)
        return is_inside and step % self.scenario.participant(name).every == 0

    def closing(self, name: str, end: int | None = None) -> bool:
        """Return whether a participant publishes once more after the last step.

        One that publishes first computes, in its last step, a state that belongs to the step
        after it. end: number of steps after which the run ends; default: as in the scenario.
        """
        spec = self.scenario.participant(name)
        end = self.scenario.steps if end is None else end
        return end is not None and spec.publishes == "first" and end % spec.every == 0

    def due_step(self, source: InputSpec, step: int) -> int | None:
        """Return which step's output an input takes at a step.

        It is the newest firing of the source at or before `step − delay`; none while absent.
        """
        due = due_step(step, source.delay, self.scenario.participant(source.source).every)
        return due if due >= 0 else None

    def text(self, steps: int) -> str:
        """Return the first steps as text: `plant@0 mission@0 controller@0 plant@1 …`.

        When all steps of the run are shown, those that publish once more close it: `plant@2000`.
        """
        end = self.scenario.steps
        last = end if end is not None and steps >= end else steps - 1
        return " ".join(
            f"{name}@{step}"
            for step in range(last + 1)
            for name in self.order
            if self.fires(name, step) or (step == end and self.closing(name))
        )


def sort(
    participants: Sequence[ParticipantSpec],
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the participants in the order in which they publish, and their algebraic loops.

    A loop is (`controller`, `mission`, `controller`), along the data: one of undelayed inputs can
    never start unless a participant in it publishes before it reads. All participants fire at step
    0, so different rates do not break a loop either. With the second participant's input from the
    first delayed in each of these loops, there is none.
    """
    names = {spec.name for spec in participants}
    # Who has to publish a step before each can: none for those that publish first.
    left = {
        spec.name: {
            item.source
            for item in spec.inputs.values()
            if item.delay == 0 and spec.publishes == "last" and item.source in names
        }
        for spec in participants
    }
    order: list[str] = []
    loops: list[tuple[str, ...]] = []
    while left:
        free = next((name for name, before in left.items() if not before & left.keys()), None)
        if free is None:
            loops.append(_loop(left))
            source, reader, *_ = loops[-1]
            left[reader].discard(source)
        else:
            order.append(free)
            del left[free]
    return tuple(order), loops


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
