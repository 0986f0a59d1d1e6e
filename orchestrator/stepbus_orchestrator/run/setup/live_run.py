"""The strategy of a run: every participant is started, here or by the user."""

from typing import Any

from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.processes.links.endpoints import Mesh
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.kernel.participants import Participants, ParticipantState
from stepbus_orchestrator.run.loop.loop import RunLoop
from stepbus_orchestrator.run.loop.strategy import NoPeers, ready_descriptions
from stepbus_orchestrator.scenario import ParticipantSpec, start_command

from .options import Options


class LiveRun:
    """Starts all participants; none is played."""

    def __init__(self, launcher: Launcher, mesh: Mesh, options: Options) -> None:
        self.peers = NoPeers()
        self.mesh = mesh
        self._launcher = launcher
        self._options = options

    def launch(self, run: RunLoop) -> None:
        """Start the participants, in the order of the options."""
        scenario = run.state.scenario
        for name in self._options.start_order or [s.name for s in scenario.participants]:
            spec = scenario.participant(name)
            start = self._admit if spec.is_external else self._start
            run.started(start(spec, run, run.start_options(spec)))

    def _start(
        self, spec: ParticipantSpec, run: RunLoop, options: dict[str, Any]
    ) -> ParticipantState:
        folder = run.state.scenario.folder
        argv, endpoint = start_command(spec, folder), self.mesh.participants[spec.name]
        child = self._launcher.start(spec, argv, endpoint, folder, **options)
        run.timing.event("spawn", spec.name, f"pid {child.pid}")
        return ParticipantState(spec, child)

    def _admit(
        self, spec: ParticipantSpec, run: RunLoop, options: dict[str, Any]
    ) -> ParticipantState:
        """Let the user start a participant."""
        endpoint = self.mesh.participants[spec.name]
        external = self._launcher.admit(spec, endpoint, run.state.scenario.folder, **options)
        self.mesh.tickets[spec.name] = external.ticket.path
        run.timing.event("external", spec.name)
        return ParticipantState(spec, external, external=external)

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how the participants describe their outputs."""
        return ready_descriptions(participants)
