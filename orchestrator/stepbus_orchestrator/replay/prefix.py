"""The prefix of a run from a recording: each participant repeats what is recorded of it."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from stepbus_orchestrator.processes.endpoints import Mesh
from stepbus_orchestrator.recording import Descriptions, Recording, SavedState, Sink, layout
from stepbus_orchestrator.replay.relay import Relay
from stepbus_orchestrator.replay.sink import Expected, PrefixSink
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_orchestrator.run.host import Strategy
from stepbus_orchestrator.run.kernel.participants import Participants
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario
from stepbus_participant import CheckpointOrder

WINDOW = 256
"""How many steps participants may be apart while each repeats its own [steps]."""


class RecordedPrefix(RunExtension):
    """The steps of a recording below `at`, as the beginning of a run.

    counts_from: participants that are not those of the recording, each with the step (at most
    `at`) from which its own outputs count; below, the recorded ones do. restored: participants that
    start from a checkpoint before a step below `at`; what is before it is taken as recorded.
    took_s: how long the run took to get to `at` [s], 0 until it is there.
    """

    def __init__(
        self,
        recording: Recording,
        at: int,
        counts_from: Mapping[str, int],
        restored: Mapping[str, SavedState] = MappingProxyType({}),
    ) -> None:
        self.at = at
        self.counts_from = counts_from
        self.restored = restored
        self.took_s = 0.0
        self._recording = recording

    is_star = True

    def adapt(self, scenario: Scenario) -> Scenario:
        """Return the scenario without the faults that the recording has the outcome of."""
        faults = tuple(fault for fault in scenario.faults if fault.step >= self.at)
        return dataclasses.replace(scenario, faults=faults)

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Return whose steps are those of the recording."""
        if not self.counts_from:
            return {}
        return {layout.BRANCH_METADATA: {name: str(at) for name, at in self.counts_from.items()}}

    def wrap(self, strategy: Strategy, sink: Sink, run: Run) -> tuple[Strategy, Sink]:
        """Return the strategy that plays the recording first, and the sink that compares."""
        scenario = run.state.scenario
        expected = Expected(self._recording, scenario.participants, self.at)
        compared = PrefixSink(
            sink,
            self._recording,
            scenario,
            expected,
            at=self.at,
            counts_from=self.counts_from,
            restored=self.restored,
            calls=recorded_calls(self._recording),
        )
        self._relay = Relay(
            run.session,
            expected,
            compared,
            at=self.at,
            restored={name: item.step for name, item in self.restored.items()},
            on_live=lambda: self._record_live(run),
        )
        return _Branch(strategy, self, self._relay), compared

    def limit(self, released: int) -> int:
        """Return the first live step, until all have repeated what is below."""
        return self._relay.limit(released)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return the checkpoint that a participant starts from."""
        saved = self.restored.get(spec.name)
        if saved is None:
            return {}
        every = self.run.state.scenario.checkpoint_steps
        order = CheckpointOrder(every=every, step=saved.step, state=str(saved.path))
        return {"checkpoint": order}

    def _record_live(self, run: Run) -> None:
        self.took_s = run.clock.monotonic() - run.state.started_at
        run.timing.event("live", text=f"from step {self.at}")


class _Branch:
    """The strategy of a run that begins with recorded steps: all are started."""

    def __init__(self, live: Strategy, prefix: RecordedPrefix, relay: Relay) -> None:
        self.peers = relay
        self._live = live
        self._prefix = prefix

    def launch(self, run: Run) -> None:
        """Start the participants, as for a run, and let them be further apart than in one."""
        state = self.peers.state = run.state
        state.is_repeating = True
        state.ends_from = self._prefix.counts_from
        for name, checkpoint in self._prefix.restored.items():
            state.barrier.start_at(name, checkpoint.step)
        state.barrier.window = max(WINDOW, state.scenario.window)
        self._live.launch(run)

    @property
    def mesh(self) -> Mesh | None:
        """Return the endpoints of its processes."""
        return self._live.mesh

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how the participants describe their outputs."""
        return self._live.descriptions(participants)
