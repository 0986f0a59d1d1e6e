"""The strategy of a run: every participant of the scenario is started."""

from collections.abc import Collection
from pathlib import Path

from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.processes.links.endpoints import Mesh
from stepbus_orchestrator.recording import Descriptions, TimingRecorder
from stepbus_orchestrator.run.kernel.participants import Participants, ParticipantState
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.loop.strategy import NoPeers, ready_descriptions
from stepbus_orchestrator.scenario import start_command

from .faults import message_faults
from .options import Options


class LiveRun:
    """Starts all participants; none is played."""

    def __init__(
        self, launcher: Launcher, mesh: Mesh, timing: TimingRecorder, options: Options
    ) -> None:
        self.peers = NoPeers()
        self._launcher = launcher
        self._mesh = mesh
        self._timing = timing
        self._options = options

    def launch(self, state: RunState) -> None:
        """Start the participants, in the order of the options."""
        scenario = state.scenario
        for name in self._options.start_order or [s.name for s in scenario.participants]:
            spec = scenario.participant(name)
            child = self._launcher.start(
                spec,
                start_command(spec, scenario.folder),
                self._mesh.participants[name],
                scenario.folder,
                faults=message_faults(scenario, name),
                has_terminal=name in self._options.debug,
                profile=self._options.profile_order(),
            )
            state.participants = {**state.participants, name: ParticipantState(spec, child)}
            self._timing.event("spawn", name, f"pid {child.pid}")

    def lost(self, name: str | None, alive: Collection[str]) -> Path | None:
        """Return what the start of a participant needs and somebody has removed."""
        return self._mesh.lost(name, alive)

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how the participants describe their outputs."""
        return ready_descriptions(participants)
