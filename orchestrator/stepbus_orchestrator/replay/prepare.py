"""From a recording to the scenario of its replay."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.processes import low_latency
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.scenario import Scenario, load
from stepbus_participant import suggest
from stepbus_schemas import WiringError

from .recorded import replayable_steps
from .rerun import origin_of, refuse_others, unpack
from .trust import recorded_commands

_NO_PROGRAM = "[python]"


def prepare(
    recording: Recording,
    participant: str,
    folder: Path,
    overrides: Sequence[str],
    *,
    own_program: bool,
    trusted: str | None = None,
) -> Scenario:
    """Unpack a recording's scenario into a new folder and return it, as it was recorded.

    own_program: whether the participant's program is not the recorded one. Programs that the
    replay does not start need not be there. trusted: fingerprint of the programs that may be
    started; None: any.

    Raises RecordingFailed when there is no scenario in it, WiringError when it has no such
    participant, ScenarioError when it cannot be replayed here.
    """
    origin = origin_of(recording)
    refuse_others(origin, trusted)
    programs = recorded_commands(recording)
    if participant not in programs:
        known = suggest(participant, programs)
        raise WiringError(f"{recording.path} has no participant {participant!r}{known}")
    path = unpack(origin, folder)
    unused = [name for name in programs if own_program or name != participant]
    scenario = load(path, [*overrides, *(f"{name}.exec={_NO_PROGRAM}" for name in unused)])
    specs = [
        dataclasses.replace(
            spec, exec=programs[spec.name] if spec.name in unused else spec.exec, on_fault=None
        )
        for spec in scenario.participants
    ]
    # What was recorded is what came of the faults; they are not injected once more.
    return dataclasses.replace(scenario, participants=tuple(specs), faults=())


def shorten(scenario: Scenario, recording: Recording, participant: str, window: int) -> Scenario:
    """Return the scenario with the steps that can be replayed, and with another window.

    Raises RecordingFailed when the recording is damaged before the first one, or has a hole: who
    is replayed would be blamed for what was not recorded.
    """
    holes = recording.holes()
    if holes:
        raise RecordingFailed(f"{recording.path} has a hole: {'; '.join(holes)}")
    steps = replayable_steps(recording, scenario, participant)
    if not steps and recording.damage:
        raise RecordingFailed(
            f"{recording.path} is damaged before the first step of {participant}: "
            f"{recording.damage}"
        )
    return dataclasses.replace(scenario, steps=steps, window=window, batch=max(1, window // 2))


def alone(scenario: Scenario, participant: str) -> Scenario:
    """Return a scenario of one participant, for the links on the bus."""
    bus = msgspec.structs.replace(scenario.bus, low_latency=low_latency(scenario))
    specs = (scenario.participant(participant),)
    return dataclasses.replace(scenario, participants=specs, bus=bus)
