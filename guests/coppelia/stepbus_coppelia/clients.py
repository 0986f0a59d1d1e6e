"""What the core and the APIs know of each other."""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol


class ApiError(Exception):
    """A call failed; the text is what the script is told."""


class Client:
    """One connection.

    name: for messages: "client 2 (legacy, 127.0.0.1:51234)". level: stepping levels; 0: it runs
    freely. waits: it asked for the next step, and is answered when that is done. heard: monotonic
    time of its last message [s].
    """

    name: str
    level: int = 0
    waits: bool = False
    heard: float


class Simulator(Protocol):
    """What both APIs speak to.

    time: simulation time [s]. state: CoppeliaSim's `sim.simulation_*` number. dt: length of a step
    [s].
    """

    time: float
    state: int
    dt: float
    clients: list[Client]

    def call(self, client: Client, function: str, args: Sequence[Any]) -> list[Any]:
        """Call a `sim.*` function by its ZeroMQ-API name; return its results. Raises ApiError."""

    def join(self, client: Client) -> None:
        """Add a client."""

    def leave(self, client: Client, why: str) -> None:
        """Remove a client: its connection is gone."""


class Endpoint(Protocol):
    """Where clients arrive: one for ZeroMQ, one per legacy port."""

    def sockets(self) -> Iterable[Any]:
        """Return what to poll for reading: objects with fileno()."""

    def receive(self, socket: Any) -> None:
        """Take and answer all that has arrived at a readable socket, without blocking."""

    def stepped(self) -> None:
        """Serve who waited: a step is done, or the simulation has started or stopped."""

    def close(self) -> None:
        """Close all sockets."""
