"""How a check differs from a plain run: what the participant learns when it joins."""

import contextlib
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msgspec import structs

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.processes.endpoints import Mesh, make_mesh
from stepbus_orchestrator.processes.slots import slot_counts
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.recorded import RecordedOutputs, recorded_descriptions
from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_orchestrator.run.kernel.descriptions import input_descriptions
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario, low_latency
from stepbus_participant import suggest
from stepbus_schemas import SPOKEN, Description, Envelope, Protocols, Refusal, Welcome, WiringError
from stepbus_tools.conformance.feeds import Feed


@dataclass(frozen=True, kw_only=True)
class Setup:
    """The configuration of one run; by default that of the scenario.

    window: steps in flight. delays: input → steps. every: source → it fires at multiples of this
    [steps]. welcome: wrong fields of the `Welcome`. refusal: why it is refused. has_slots: the
    program may use slots (P17). own_peers: the peers have a link of their own to the participant.
    join_timeout_s, protocols: of its ticket [s], [protocol numbers].
    """

    window: int | None = None
    delays: Mapping[str, int] = field(default_factory=dict)
    every: Mapping[str, int] = field(default_factory=dict)
    welcome: Mapping[str, Any] = field(default_factory=dict)
    refusal: str | None = None
    has_slots: bool = False
    own_peers: bool = False
    join_timeout_s: float | None = None
    protocols: Protocols = SPOKEN

    def scenario(self, scenario: Scenario, participant: str) -> Scenario:
        """Return the scenario with this configuration."""
        window = self.window or scenario.window
        specs = tuple(self._spec(spec, participant) for spec in scenario.participants)
        batch = scenario.batch if self.window is None else max(1, window // 2)
        return dataclasses.replace(scenario, window=window, batch=batch, participants=specs)

    def _spec(self, spec: ParticipantSpec, participant: str) -> ParticipantSpec:
        spec = structs.replace(spec, every=self.every.get(spec.name, spec.every))
        if spec.name != participant:
            return spec
        inputs = {
            name: structs.replace(item, delay=self.delays.get(name, item.delay))
            for name, item in spec.inputs.items()
        }
        limit_s = self.join_timeout_s or spec.deadlines.join_s
        return structs.replace(spec, inputs=inputs, join_timeout_ns=round(limit_s * 1e9))

    def answer(self, scenario: Scenario, spec: ParticipantSpec, token: str) -> Envelope:
        """Return the answer to the participant's request to join."""
        if self.refusal is not None:
            return Refusal(reason=self.refusal)
        welcome: Welcome = welcome_of(scenario, spec, token)
        return structs.replace(welcome, **self.welcome)

    def mesh(
        self,
        scenario: Scenario,
        spec: ParticipantSpec,
        folder: Path,
        held: contextlib.ExitStack,
    ) -> Mesh:
        """Return the links: orchestrator, peers where they have their own, and the participant.

        held: as of `make_mesh`.
        """
        first = next(iter(spec.inputs.values()), None)
        participants: tuple[ParticipantSpec, ...] = (spec,)
        if self.own_peers and first is not None:
            participants = (scenario.participant(first.source), spec)
        # Bulk content is played in messages, but for the checks of slots.
        is_quick = low_latency(scenario) and not slot_counts(scenario)
        bus = structs.replace(scenario.bus, low_latency=is_quick)
        linked = dataclasses.replace(scenario, participants=participants, bus=bus)
        return make_mesh(linked, folder, None, held)


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
            (
                f"no inputs for {participant}: the run of {scenario.file} to record them "
                f"failed: {result.reason}"
            ),
            participant=result.participant,
            step=result.at_step,
            code=result.exit_code,
        )
    if not result.steps:
        raise WiringError(f"{scenario.file} has no steps to play")
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
    sources = {item.source: scenario.participant(item.source) for item in spec.inputs.values()}
    described = recorded_descriptions(recording)
    outputs = RecordedOutputs(recording, sources.values())
    return Material(
        scenario=scenario,
        spec=spec,
        feed={
            name: {n: outputs.take(name, n) for n in range(0, scenario.steps or 0, source.every)}
            for name, source in sources.items()
        },
        descriptions=input_descriptions(
            scenario, {s.name: described.get(s.name, {}) for s in scenario.participants}
        )[spec.name],
        recording=path,
    )
