"""What both remote APIs, and the simulation that they speak to, have in common."""

from collections.abc import Iterable
from typing import Any, Protocol


class ApiError(Exception):
    """A call failed; the text is what the script is told."""


class Client:
    """One connection of a script.

    name: for messages. level: how many times it has turned stepping on; 0: it runs freely. waits:
    it is answered when the next step is done, or at the time `until` [s].
    is_recorded: whether its calls are recorded.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.level = 0
        self.waits = False
        self.until = 0.0
        self.is_recorded = True


class Simulator(Protocol):
    """The simulation, as an API sees it.

    time: simulation time [s]. state: one of `sim.simulation_*`. step: its number. dt: length of a
    step [s].
    """

    time: float
    state: int
    step: int
    dt: float
    clients: list[Client]

    def call(self, client: Client, function: str, args: list[Any]) -> list[Any]:
        """Call a function by its name without `sim.`; return its results. Raises ApiError."""

    def join(self, client: Client) -> None:
        """Take a new connection."""

    def leave(self, client: Client, why: str) -> None:
        """Take note that a connection is gone; why: as the end of a sentence about it."""


class Endpoint(Protocol):
    """Where clients of one API connect."""

    def sockets(self) -> Iterable[Any]:
        """Return what is polled for reading."""

    def receive(self, socket: Any) -> None:
        """Take and answer what has arrived at a socket, without waiting."""

    def stepped(self) -> None:
        """Answer who waited: a step is done, or the simulation has started or stopped."""

    def close(self) -> None:
        """Close all connections."""
