"""What a controller reports: one status after the other, and warnings."""

from collections import deque

from stepbus_schemas import GoalState, GoalStatus


class Reports:
    """Statuses and warnings that wait to be published."""

    def __init__(self) -> None:
        self._statuses: deque[GoalStatus] = deque()
        self._warnings: list[str] = []

    def status(self, number: int, state: GoalState, cause: str = "", text: str = "") -> None:
        """Add a status of a goal."""
        self._statuses.append(GoalStatus(id=number, state=state, cause=cause, text=text))

    def warn(self, *texts: str) -> None:
        """Add warnings; empty texts are none."""
        self._warnings += [text for text in texts if text]

    def next_status(self) -> GoalStatus | None:
        """Return the oldest status that was not published yet; None: there is none."""
        return self._statuses.popleft() if self._statuses else None

    def take_warnings(self) -> list[str]:
        """Return the warnings that were not published yet."""
        warnings, self._warnings = self._warnings, []
        return warnings
