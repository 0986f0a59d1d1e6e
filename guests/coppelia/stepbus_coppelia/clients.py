"""What both remote APIs, and the simulation that they speak to, have in common."""

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from stepbus_coppelia.legacy.server import LegacyEndpoint
    from stepbus_coppelia.session import Session
    from stepbus_coppelia.zmq_api import ZmqEndpoint

Simulator: TypeAlias = "Session"
Endpoint: TypeAlias = "LegacyEndpoint | ZmqEndpoint"


class ApiError(Exception):
    """A call failed; the text is what the script is told."""


class Client:
    """One connection of a script.

    name: for messages. level: how many times it has turned stepping on; 0: it runs freely. waits:
    it is answered when the next step is done, or at the time `until` [s].
    is_recorded: whether its calls are recorded.
    """

    def __init__(self, name: str) -> None:
        self.name, self.is_recorded = name, True
        self.level, self.waits, self.until = 0, False, 0.0
