"""Events of participants: shown during the run; warnings are kept for its result."""

from collections.abc import Collection

import msgspec

from stepbus_orchestrator.scenario import Scenario
from stepbus_schemas import Event

from .progress import Observer

# More than that from one output is noise; the recording has them all.
_MOST_SHOWN = 50


_FEW = 5
"""Of fewer firings, nobody can say that an output is silent."""

_OCCASIONAL = frozenset(
    (
        *("BaseCommand/1", "Bytes/1", "Detections/1", "Event/1", "Goal/1", "GoalStatus/1"),
        *("GripperCommand/1", "Image/1", "Plan/1", "PlanRequest/1", "Text/1"),
    )
)
"""Types of which a run may have no message."""


class Warned(msgspec.Struct, frozen=True, kw_only=True):
    """A warning or an error that a participant reported.

    source: `participant.output`. step: at which it was published. text: one sentence.
    """

    source: str
    step: int
    level: str
    text: str


class Events:
    """Takes every recorded event, in the order of the recording, and shows it.

    observer: shows it. warnings: the first ones of each output; count: of all.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._shown: dict[str, int] = {}
        self.warnings: list[Warned] = []
        self.count = 0

    def take(self, participant: str, port: str, step: int, event: Event) -> None:
        """Take an event; each line of its text is a sentence of its own."""
        for text in filter(None, event.text.splitlines()):
            self._take_line(f"{participant}.{port}", participant, step, event.level, text)

    def add_warning(self, source: str, text: str) -> None:
        """Add a warning of the orchestrator itself."""
        self._take_line(source, "orchestrator", 0, "warning", text)

    def add_silent(self, scenario: Scenario, silent: Collection[tuple[str, str]], end: int) -> None:
        """Warn about outputs that never published in a run of so many steps."""
        for spec in scenario.participants:
            if end // spec.every < _FEW:
                continue
            for port, output in spec.outputs.items():
                if (spec.name, port) in silent and output.type not in _OCCASIONAL:
                    text = f"never published in {end} steps ({output.type})"
                    self._take_line(f"{spec.name}.{port}", spec.name, end, "warning", text)

    def _take_line(self, source: str, who: str, step: int, level: str, text: str) -> None:
        self._shown[source] = self._shown.get(source, 0) + 1
        is_shown = self._shown[source] <= _MOST_SHOWN
        if level != "info":
            self.count += 1
            if is_shown:
                self.warnings.append(Warned(source=source, step=step, level=level, text=text))
        if is_shown:
            self._observer.event(level, who, step, text)
        elif self._shown[source] == _MOST_SHOWN + 1:
            self._observer.event("info", who, step, f"the further events of {source} are recorded")
