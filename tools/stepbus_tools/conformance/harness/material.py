"""The inputs that the kit plays: what the peers published in a short run of the scenario."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario
from stepbus_orchestrator.toolkit import (
    Options,
    Recorded,
    input_descriptions,
    recorded_descriptions,
    run,
)
from stepbus_participant import suggest
from stepbus_schemas import Description, WiringError

from .feeds import Feed, Ports

_LEAST_STEPS = 24
_LEAST_FIRINGS = 12


@dataclass(frozen=True, kw_only=True)
class Material:
    """Everything the kit plays to one participant.

    scenario: as many steps as there is material for. feed: by source. descriptions: of each
    input, with names. recording: the run's `run.mcap`, where it was kept.
    """

    scenario: Scenario
    spec: ParticipantSpec
    feed: Feed
    descriptions: Mapping[str, Description]
    recording: Path

    @property
    def steps(self) -> int:
        """Return the number of steps that there is material for."""
        return self.scenario.steps or 0


def record(scenario: Scenario, participant: str, folder: Path) -> Material:
    """Run a scenario for some steps and return what the sources of a participant published.

    folder: for the run's files. Raises WiringError when it has no such participant, RunFailure
    when the run fails.
    """
    spec = find(scenario, participant)
    wanted = max(_LEAST_STEPS, _LEAST_FIRINGS * spec.every)
    short = dataclasses.replace(scenario, steps=min(wanted, scenario.steps or wanted))
    result = run(short, Options(out=folder))
    if result.exit_code:
        raise RunFailure(
            f"no inputs for {participant}: the run of {scenario.file} that should record them "
            f"failed: {result.reason}",
            participant=result.participant,
            step=result.at_step,
            code=result.exit_code,
        )
    if not result.steps:
        raise WiringError(f"{scenario.file} has no steps, so there is nothing to play")
    return read(dataclasses.replace(short, steps=result.steps), participant, result.recording)


def find(scenario: Scenario, participant: str) -> ParticipantSpec:
    """Return the participant; raises WiringError when there is none of that name."""
    names = [spec.name for spec in scenario.participants]
    if participant not in names:
        known = suggest(participant, names)
        raise WiringError(f"{scenario.file} has no participant {participant!r}{known}")
    return scenario.participant(participant)


def read(scenario: Scenario, participant: str, path: Path) -> Material:
    """Return the material from a recording of a scenario that is at least as long.

    Raises WiringError as `find`, RecordingFailed when it cannot be read.
    """
    spec = find(scenario, participant)
    recording = Recording(path)
    sources = dict.fromkeys(item.source for item in spec.inputs.values())
    described = recorded_descriptions(recording)
    return Material(
        scenario=scenario,
        spec=spec,
        feed={name: _rows(recording, scenario, name) for name in sources},
        descriptions=input_descriptions(
            scenario, {s.name: described.get(s.name, {}) for s in scenario.participants}
        )[spec.name],
        recording=path,
    )


def _rows(recording: Recording, scenario: Scenario, name: str) -> dict[int, Ports]:
    source = scenario.participant(name)
    track = Recorded(recording, source)
    return {step: track.take() for step in range(0, scenario.steps or 0, source.every)}
