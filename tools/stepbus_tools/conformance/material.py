"""What is played to a participant: recorded outputs of its sources, and other forms of them."""

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from msgspec import structs

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.processes.slots import slot_counts
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.recorded import RecordedOutputs, recorded_descriptions
from stepbus_orchestrator.run.kernel.descriptions import input_descriptions
from stepbus_orchestrator.run.player import Ports
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario, low_latency
from stepbus_participant import suggest
from stepbus_schemas import SPOKEN, Description, Protocols, Refusal, Welcome, WiringError

Feed = Mapping[str, Mapping[int, Ports]]
"""Source → step → its messages."""

Edit = Callable[[str, str, bytes], bytes]
"""Returns another message for (source, port, message)."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """The configuration of one run; by default that of the scenario.

    window: steps in flight. delays: input → steps. every: source → it fires at multiples of this
    [steps]. answer: makes another answer to its `Hello` out of the `Welcome`. has_slots: the
    program may use slots (P17). own_peers: the peers have a link of their own to the participant.
    join_timeout_s, protocols: of its ticket [s], [protocol numbers].
    """

    window: int | None = None
    delays: Mapping[str, int] = field(default_factory=dict)
    every: Mapping[str, int] = field(default_factory=dict)
    answer: Callable[[Welcome], Welcome | Refusal] = lambda welcome: welcome
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

    def linked(self, scenario: Scenario, spec: ParticipantSpec) -> Scenario:
        """Return the scenario of the processes with a link: one of the peers, the participant."""
        sources = (item.source for item in spec.inputs.values())
        peer = next(map(scenario.participant, sources), None) if self.own_peers else None
        # Bulk content is played in messages, but for the checks of slots.
        is_quick = low_latency(scenario) and not slot_counts(scenario)
        bus = structs.replace(scenario.bus, low_latency=is_quick)
        specs = (spec,) if peer is None else (peer, spec)
        return dataclasses.replace(scenario, participants=specs, bus=bus)


_LEAST_STEPS = 24
_LEAST_FIRINGS = 12


@dataclass(frozen=True, kw_only=True)
class Material:
    """The messages that the kit plays to one participant.

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
    """Run a scenario for some steps and return the outputs of the sources of a participant.

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


# --- other forms of a feed --------------------------------------------------------------------


def edited(feed: Feed, edit: Edit) -> Feed:
    """Return a feed with every message replaced by `edit`."""
    return each_step(
        feed,
        lambda source, _, row: {port: edit(source, port, data) for port, data in row.items()},
    )


def each_step(feed: Feed, change: Callable[[str, int, Ports], Ports]) -> Feed:
    """Return a feed with other outputs: `change` gets source, step and outputs."""
    return {
        source: {step: change(source, step, row) for step, row in rows.items()}
        for source, rows in feed.items()
    }


def thinned(feed: Feed, every: Mapping[str, int]) -> Feed:
    """Return a feed in which sources publish at multiples of a step only, and nothing between."""
    return each_step(feed, lambda source, step, row: {} if step % every[source] else row)


def shifted(feed: Feed, ports: Collection[tuple[str, str]], delay: int) -> Feed:
    """Return a feed in which some ports, as (source, port), come `delay` steps later."""

    def change(source: str, step: int, row: Ports) -> Ports:
        earlier = feed[source].get(step - delay, {})
        own = {port: data for port, data in row.items() if (source, port) not in ports}
        return own | {port: data for port, data in earlier.items() if (source, port) in ports}

    return each_step(feed, change)


def repeated(feed: Feed) -> Feed:
    """Return a feed in which a step without a port has the message of the step before."""
    held: dict[str, dict[str, bytes]] = {source: {} for source in feed}

    def change(source: str, _: int, row: Ports) -> Ports:
        held[source] = {**held[source], **row}
        return held[source]

    return each_step(feed, change)


def reverse_description(description: Description) -> Description:
    """Return a description with its names, and all rows that belong to them, reversed."""
    return msgspec.structs.replace(
        description,
        names=description.names[::-1],
        limits={key: row[::-1] for key, row in description.limits.items()},
        details={key: row[::-1] for key, row in description.details.items()},
    )
