"""What differs between a run, a replay and a description: who is started, who is played."""

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Protocol

from stepbus_orchestrator.processes.links.endpoints import Mesh
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.kernel.participants import Participants

if TYPE_CHECKING:
    from .loop import RunLoop


class Peers(Protocol):
    """Participants whose messages the orchestrator publishes, from a recording."""

    @property
    def names(self) -> Collection[str]:
        """Return who they are."""

    def send_handshake(self) -> None:
        """Prove their links; called again and again until all participants are ready (P4.6)."""

    def publish_below(self, step: int, reported: dict[str, int]) -> None:
        """Publish all outputs of steps below `step`; reported: gets the newest of each."""

    def close(self, step: int, names: Iterable[str], reported: dict[str, int]) -> None:
        """Publish the closing outputs of those named; reported: gets the newest of each."""


class NoPeers:
    """The peers of a run whose participants are all started."""

    names: Collection[str] = ()

    def send_handshake(self) -> None:
        """Do nothing."""

    def publish_below(self, step: int, reported: dict[str, int]) -> None:
        """Do nothing."""

    def close(self, step: int, names: Iterable[str], reported: dict[str, int]) -> None:
        """Do nothing."""


class Strategy(Protocol):
    """How the phases of a run get their participants."""

    @property
    def peers(self) -> Peers:
        """Return the participants that are played instead of started."""

    def launch(self, run: "RunLoop") -> None:
        """Start the others, and hand each to `run.started`.

        Raises StartFailed when one cannot be started.
        """

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how all outputs are described, once all participants are ready."""

    @property
    def mesh(self) -> Mesh | None:
        """Return the endpoints of its processes; None: they are all in this one."""


def ready_descriptions(participants: Participants) -> Descriptions:
    """Return how participants that are ready describe their own outputs."""
    ready = ((name, participant.ready) for name, participant in participants.items())
    return {name: item.outputs if item else {} for name, item in ready}
