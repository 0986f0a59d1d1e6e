"""Sends the goals of a list to a controller, one after the other.

Run as `stepbus_mission.goals:GoalSequence`.
"""

from collections.abc import Mapping

from stepbus_mission.goals import Params
from stepbus_participant import Config, Participant, Ports, Step
from stepbus_schemas import Description, Event, GoalStatus, Message, RunError


class GoalSequence(Participant):
    """Sends the next goal when the one before has succeeded, and ends the run after the last one.

    Input: one GoalStatus/1. Outputs: one Goal/1, and an Event/1 with a sentence for every goal that
    is accepted or over. Raises RunError where one fails. `Params` has the parameters.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._status_port = ports.input_of("GoalStatus/1")
        self._goal_port = ports.output_of("Goal/1")
        self._event_port = ports.output_of("Event/1")
        ports.outputs_are("Goal/1", "Event/1")
        self._goals = config.read(Params, ports.problems).goals
        self._number = -1
        self._reported = ""

    def describe(self) -> Mapping[str, Description]:
        """Return empty descriptions: no output has named elements."""
        return dict.fromkeys((self._goal_port, self._event_port), Description())

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the next goal once the last one is over, and what became of it."""
        if self._number < 0:
            return self._next(step)
        status = step.get(self._status_port, GoalStatus)
        if status is None or status.id != self._number or self._number >= len(self._goals):
            return {}
        text = f"{self._label()}: {status.state}, {status.text}"
        if status.state in {"failed", "cancelled"}:
            raise RunError(f"{self._label()} {status.state}: {status.text or status.cause}")
        if status.state == "running" or text == self._reported:
            return {}
        self._reported = text
        event = {self._event_port: Event(level="info", text=text)}
        return event if status.state == "accepted" else {**event, **self._next(step)}

    def _next(self, step: Step) -> dict[str, Message]:
        self._number += 1
        if self._number < len(self._goals):
            return {self._goal_port: self._goals[self._number].goal(self._number)}
        step.end(f"{self.config.name}: {len(self._goals)} of {len(self._goals)} goals are done")
        return {}

    def _label(self) -> str:
        return f"goal {self._number + 1} of {len(self._goals)} ({self._goals[self._number].type})"
