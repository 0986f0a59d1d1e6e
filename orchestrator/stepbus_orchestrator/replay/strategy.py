"""The strategy of a replay: one participant is started, its peers are played."""

from collections.abc import Callable
from typing import Any

from stepbus_orchestrator.processes.links.endpoints import Mesh
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.kernel.participants import Participants, ParticipantState, Process
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_participant import Bus
from stepbus_schemas import Decoder, MessageError, Outputs

from .peers import Peers

_decode_outputs = Decoder(Outputs)


class Replay:
    """Starts one participant, and plays the others from a recording.

    start: starts its process. recorded: the descriptions of all outputs. mesh: of the replay.
    """

    def __init__(
        self,
        spec: ParticipantSpec,
        start: Callable[[], Process],
        peers: Peers,
        recorded: Descriptions,
        *,
        bus: Bus,
        mesh: Mesh,
    ) -> None:
        self.peers = peers
        self.mesh = mesh
        self._spec = spec
        self._start = start
        self._recorded = recorded
        self._bus = bus
        self._newest: Any = None
        # Nobody waits for it, so that only its outputs themselves show how far it has come.
        bus.subscribe(f"out/{spec.name}", self._see)

    def _see(self, sample: Any) -> None:
        self._newest = sample

    def newest_step(self) -> int:
        """Return the newest step the participant was seen to publish; −1 before the first."""
        try:
            return _decode_outputs(self._bus.payload(self._newest)).step if self._newest else -1
        except MessageError:
            return -1

    def launch(self, run: Run) -> None:
        """Start the participant."""
        run.started(ParticipantState(self._spec, self._start(), self.newest_step))

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how all outputs were described when they were recorded."""
        return self._recorded
