"""What the inputs of a participant held at a step of a recording."""

from __future__ import annotations

from stepbus_orchestrator.analysis.comparison import PortComparison, Tolerance
from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, Schedule

from .result import InputValue


def inputs_of(
    recording: Recording, scenario: Scenario, spec: ParticipantSpec, step: int
) -> dict[str, InputValue]:
    """Return what a participant computed its outputs of a step from."""
    # What it publishes first is the result of its step before.
    step -= spec.every if spec.publishes == "first" else 0
    schedule = Schedule.of(scenario)
    return {
        name: _held(recording, f"{item.source}/{item.port}", schedule.due_step(item, step))
        for name, item in spec.inputs.items()
    }


def _held(recording: Recording, topic: str, due: int | None) -> InputValue:
    if due is None or topic not in recording:
        return InputValue(topic=topic, step=-1, value=None)
    held = None
    for entry in recording[topic].entries():
        if entry.step > due:
            break
        held = entry
    if held is None:
        return InputValue(topic=topic, step=-1, value=None)
    plain = PortComparison(topic, recording.ports[topic].type, Tolerance()).plain
    return InputValue(topic=topic, step=held.step, value=plain(held.data))
