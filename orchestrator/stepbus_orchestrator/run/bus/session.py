"""One run's end of the bus: who is on it, what is published, and what has arrived."""

from stepbus_orchestrator.errors import BusFailed
from stepbus_orchestrator.scenario import Scenario
from stepbus_participant import Bus, BusError, Endpoint, ZenohBus

from .announcer import Announcer
from .inbox import Inbox


def open_bus(endpoint: Endpoint, run: str) -> ZenohBus:
    """Open a session on the bus of a run; raises BusFailed."""
    try:
        return ZenohBus(endpoint, run)
    except BusError as exc:
        raise BusFailed(str(exc)) from exc


class Session:
    """The bus of one run, with its token.

    limit_s: how long a participant may read nothing while something is published to it [s];
    default: the longest deadline for a step.
    """

    def __init__(
        self, scenario: Scenario, bus: Bus, token: str, limit_s: float | None = None
    ) -> None:
        self.scenario = scenario
        self.bus = bus
        self.token = token
        longest_s = max(spec.deadlines.step_s for spec in scenario.participants)
        self.announcer = Announcer(bus, token, longest_s if limit_s is None else limit_s)
        self.inbox = Inbox(bus.queue())
