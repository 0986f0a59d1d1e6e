"""How a check differs from a plain run: what the participant learns when it joins."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, low_latency
from stepbus_orchestrator.toolkit import Mesh, make_mesh, welcome_of
from stepbus_schemas import Envelope, Refusal, Welcome


@dataclass(frozen=True, kw_only=True)
class Setup:
    """The configuration of one run; by default that of the scenario.

    window: steps in flight. delays: input → steps. every: source → it fires at multiples of this
    [steps]. welcome: wrong fields of the `Welcome`. refusal: why it is
    refused. own_peers: the peers have a link of their own to the participant.
    join_timeout_s: of its ticket [s].
    """

    window: int | None = None
    delays: Mapping[str, int] = field(default_factory=dict)
    every: Mapping[str, int] = field(default_factory=dict)
    welcome: Mapping[str, Any] = field(default_factory=dict)
    refusal: str | None = None
    own_peers: bool = False
    join_timeout_s: float | None = None

    def scenario(self, scenario: Scenario, participant: str) -> Scenario:
        """Return the scenario with this configuration."""
        window = self.window or scenario.window
        specs = tuple(self._spec(spec, participant) for spec in scenario.participants)
        batch = scenario.batch if self.window is None else max(1, window // 2)
        return dataclasses.replace(scenario, window=window, batch=batch, participants=specs)

    def _spec(self, spec: ParticipantSpec, participant: str) -> ParticipantSpec:
        spec = dataclasses.replace(spec, every=self.every.get(spec.name, spec.every))
        if spec.name != participant:
            return spec
        inputs = {
            name: dataclasses.replace(item, delay=self.delays.get(name, item.delay))
            for name, item in spec.inputs.items()
        }
        limit_s = self.join_timeout_s or spec.deadlines.join_s
        deadlines = dataclasses.replace(spec.deadlines, join_s=limit_s)
        return dataclasses.replace(spec, inputs=inputs, deadlines=deadlines)

    def answer(self, scenario: Scenario, spec: ParticipantSpec, token: str) -> Envelope:
        """Return the answer to the participant's request to join."""
        if self.refusal is not None:
            return Refusal(reason=self.refusal)
        welcome: Welcome = welcome_of(scenario, spec, token)
        return msgspec.structs.replace(welcome, **self.welcome)

    def mesh(self, scenario: Scenario, spec: ParticipantSpec, folder: Path) -> Mesh:
        """Return the links: orchestrator, peers where they have their own, and the participant."""
        first = next(iter(spec.inputs.values()), None)
        participants: tuple[ParticipantSpec, ...] = (spec,)
        if self.own_peers and first is not None:
            participants = (scenario.participant(first.source), spec)
        bus = msgspec.structs.replace(scenario.bus, low_latency=low_latency(scenario))
        return make_mesh(
            dataclasses.replace(scenario, participants=participants, bus=bus), folder, None
        )
