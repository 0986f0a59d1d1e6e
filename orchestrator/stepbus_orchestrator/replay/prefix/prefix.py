"""The prefix of a run from a recording: each participant repeats what is recorded of it."""

import time
from collections.abc import Mapping
from types import MappingProxyType

from stepbus_orchestrator.processes.links.endpoints import Mesh
from stepbus_orchestrator.recording import (
    Descriptions,
    Recording,
    SavedState,
    Sink,
    TimingRecorder,
)
from stepbus_orchestrator.run.bus.session import Session
from stepbus_orchestrator.run.control.calls import recorded_calls
from stepbus_orchestrator.run.kernel.gates import Gate
from stepbus_orchestrator.run.kernel.participants import Participants
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.loop.strategy import Strategy

from .expected import Expected
from .relay import Relay
from .sink import PrefixSink

WINDOW = 256
"""How many steps participants may be apart while each repeats its own [steps]."""


class RecordedPrefix:
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

    def join(
        self, live: Strategy, session: Session, recorder: Sink, timing: TimingRecorder
    ) -> tuple[Strategy, Sink, Gate]:
        """Return strategy, sink and gate of the run."""
        scenario = session.scenario
        expected = Expected(self._recording, scenario.participants, self.at)
        sink = PrefixSink(
            recorder,
            self._recording,
            scenario,
            expected,
            at=self.at,
            counts_from=self.counts_from,
            restored=self.restored,
            calls=recorded_calls(self._recording),
        )
        strategy = _Branch(live, self)
        relay = Relay(
            session,
            expected,
            sink,
            at=self.at,
            restored={name: item.step for name, item in self.restored.items()},
            on_live=lambda: self._record_live(strategy, timing),
        )
        strategy.peers = relay
        return strategy, sink, relay

    def _record_live(self, strategy: "_Branch", timing: TimingRecorder) -> None:
        if strategy.state is not None:
            self.took_s = time.monotonic() - strategy.state.started_at
        timing.event("live", text=f"from step {self.at}")


class _Branch:
    """The strategy of a run that begins with recorded steps: all are started."""

    peers: Relay

    def __init__(self, live: Strategy, prefix: RecordedPrefix) -> None:
        self.state: RunState | None = None
        self._live = live
        self._prefix = prefix

    def launch(self, state: RunState) -> None:
        """Start the participants, as for a run, and let them be further apart than in one."""
        self.state = self.peers.state = state
        state.is_prefix = True
        state.counts_from = self._prefix.counts_from
        state.restored = self._prefix.restored
        for name, checkpoint in state.restored.items():
            state.barrier.start_at(name, checkpoint.step)
        state.barrier.window = max(WINDOW, state.scenario.window)
        self._live.launch(state)

    @property
    def mesh(self) -> Mesh | None:
        """Return the endpoints of its processes."""
        return self._live.mesh

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how the participants describe their outputs."""
        return self._live.descriptions(participants)
