"""What a replay came to."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from stepbus_orchestrator.analysis.code import FileChange
from stepbus_orchestrator.analysis.divergence import Divergence, PortResult, port_lines
from stepbus_orchestrator.analysis.tolerance import short
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.schedule import Schedule


class InputValue(msgspec.Struct, frozen=True, kw_only=True):
    """What an input held: the message of a topic at a step; −1 and None while it was absent."""

    topic: str
    step: int
    value: Any


class ReplayResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a replay: how one participant compares with its recording.

    equal: whether all outputs are equal, within the tolerance. steps: number of replayed steps.
    divergence: the first divergence. inputs: inputs of the participant at that step. ports: ordered
    by the step of their first divergence. wall_s: from the first trigger to the end [s]. updated:
    the new reference recording, if requested. source: the scenario in the work tree whose program
    was started; empty: the recorded copy, or another program. changes: how it differs from the
    recorded one. notes: other differences. code: the files that differ, line by line.
    """

    recording: str
    participant: str
    equal: bool
    steps: int
    divergence: Divergence | None
    inputs: Mapping[str, InputValue]
    ports: Sequence[PortResult]
    wall_s: float
    updated: str | None
    source: str
    changes: Sequence[str]
    notes: Sequence[str]
    code: Sequence[FileChange] = ()

    @property
    def steps_per_s(self) -> float:
        """Return how many steps were replayed per second of wall time; 0 without any."""
        return self.steps / self.wall_s if self.wall_s else 0.0

    def text(self) -> str:
        """Return the result as text, with the first divergence and its inputs first."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        if self.divergence is None:
            yield f"{self.participant}: equal to the recording over {self.steps} steps"
        else:
            yield f"{self.participant} differs from the recording"
            yield f"first divergence: {self.divergence.text('recording', 'replay')}"
            for name, item in self.inputs.items():
                origin = f"{item.topic}@{item.step}" if item.step >= 0 else f"{item.topic}, absent"
                yield f"  input {name} ({origin}): {short(item.value)}"
        for port in self.ports:
            yield from port_lines(port, "recording", "replay", self.divergence)
        if self.source and not self.changes:
            yield f"tested {self.source}, as recorded"
        elif self.source:
            yield f"tested {self.source}, changed since the recording:"
            yield from (f"  {change}" for change in self.changes)
            if not self.equal:
                yield from (line for change in self.code for line in change.diff)
        for note in self.notes:
            yield f"note: {note}"


def inputs_of(
    recording: Recording, scenario: Scenario, participant: str, step: int
) -> dict[str, InputValue]:
    """Return what a participant computed its outputs of a step from."""
    spec, schedule = scenario.participant(participant), Schedule(scenario)
    # What it publishes first is the result of its step before.
    step -= spec.every if spec.publishes == "first" else 0
    held: dict[str, InputValue] = {}
    for name, item in spec.inputs.items():
        topic, due = f"{item.source}/{item.port}", schedule.due_step(item, step)
        found = None
        if due is not None and topic in recording:
            found = recording[topic].latest(due * scenario.step_ns)
        at, value = found or (-1, None)
        held[name] = InputValue(topic=topic, step=at, value=msgspec.to_builtins(value))
    return held
