"""The phases of a run, and which may follow which."""

from collections.abc import Mapping
from enum import StrEnum


class RunPhase(StrEnum):
    """What a run is doing.

    Start-up: participants join, load their models and get ready (P4). Stepping: steps are released
    (P5). Fallback: the same, with messages published for a participant that has failed. Closing:
    closing outputs come in (P11.3). Shutdown: processes end (P11.4).
    """

    START_UP = "start-up"
    STEPPING = "stepping"
    FALLBACK = "fallback"
    CLOSING = "closing"
    SHUTDOWN = "shutdown"

    @property
    def is_stepping(self) -> bool:
        """Return whether steps are released."""
        return self is RunPhase.STEPPING or self is RunPhase.FALLBACK

    @property
    def is_stopping(self) -> bool:
        """Return whether participants have been asked to end."""
        return self is RunPhase.CLOSING or self is RunPhase.SHUTDOWN

    @property
    def shown(self) -> str:
        """Return it as users see it: `starting`, `stepping` or `stopping`."""
        if self is RunPhase.START_UP:
            return "starting"
        return "stepping" if self.is_stepping else "stopping"


NEXT: Mapping[RunPhase, frozenset[RunPhase]] = {
    RunPhase.START_UP: frozenset({RunPhase.STEPPING, RunPhase.SHUTDOWN}),
    RunPhase.STEPPING: frozenset({RunPhase.FALLBACK, RunPhase.CLOSING, RunPhase.SHUTDOWN}),
    RunPhase.FALLBACK: frozenset({RunPhase.CLOSING, RunPhase.SHUTDOWN}),
    RunPhase.CLOSING: frozenset({RunPhase.SHUTDOWN}),
    RunPhase.SHUTDOWN: frozenset(),
}
"""Every phase ends in shutdown, whatever happens in it; none comes twice."""
