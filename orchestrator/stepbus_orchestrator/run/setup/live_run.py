"""The strategy of a run: every participant is started, here or by somebody else."""

from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.processes.links.endpoints import Mesh
from stepbus_orchestrator.recording import Descriptions, TimingRecorder
from stepbus_orchestrator.run.control.invitations import Invitations
from stepbus_orchestrator.run.kernel.participants import Participants, ParticipantState
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.loop.strategy import NoPeers, ready_descriptions
from stepbus_orchestrator.scenario import ParticipantSpec, start_command

from .faults import message_faults
from .options import Options


class LiveRun:
    """Starts all participants; none is played."""

    def __init__(
        self,
        launcher: Launcher,
        mesh: Mesh,
        timing: TimingRecorder,
        options: Options,
        invitations: Invitations,
    ) -> None:
        self.peers = NoPeers()
        self._launcher = launcher
        self.mesh = mesh
        self._timing = timing
        self._options = options
        self._invitations = invitations

    def launch(self, state: RunState) -> None:
        """Start the participants, in the order of the options."""
        scenario = state.scenario
        for name in self._options.start_order or [s.name for s in scenario.participants]:
            spec = scenario.participant(name)
            started = self._admit(spec, state) if spec.is_external else self._start(spec, state)
            state.participants = {**state.participants, name: started}

    def _start(self, spec: ParticipantSpec, state: RunState) -> ParticipantState:
        scenario = state.scenario
        child = self._launcher.start(
            spec,
            start_command(spec, scenario.folder),
            self.mesh.participants[spec.name],
            scenario.folder,
            faults=message_faults(scenario, spec.name),
            has_terminal=spec.name in self._options.debug,
            profile=self._options.profile_order(),
            checkpoint=state.checkpoint_order(spec.name),
        )
        self._timing.event("spawn", spec.name, f"pid {child.pid}")
        return ParticipantState(spec, child)

    def _admit(self, spec: ParticipantSpec, state: RunState) -> ParticipantState:
        """Let somebody else start a participant."""
        scenario = state.scenario
        external = self._launcher.admit(
            spec,
            self.mesh.participants[spec.name],
            self._options.tickets.get(spec.name, self._options.out / f"{spec.name}.ticket"),
            scenario.folder,
            faults=message_faults(scenario, spec.name),
            profile=self._options.profile_order(),
            checkpoint=state.checkpoint_order(spec.name),
        )
        self.mesh.tickets[spec.name] = external.ticket.path
        self._timing.event("external", spec.name)
        admitted = ParticipantState(spec, external, external=external)
        self._invitations.add(admitted)
        return admitted

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how the participants describe their outputs."""
        return ready_descriptions(participants)
