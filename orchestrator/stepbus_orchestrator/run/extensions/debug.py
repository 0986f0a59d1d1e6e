"""Runs participants in a debugger: they have a terminal, and no deadline."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import suggest
from stepbus_schemas import WiringError

# Eleven days; in a ticket and for the bus's queries it has to be a finite number.
_SUSPENDED_NS = 10**15
_NO_DEADLINES = {
    f"{phase}_timeout_ns": _SUSPENDED_NS for phase in ("spawn", "join", "ready", "step", "stop")
}


class Debug(RunExtension):
    """Takes the deadlines of participants away.

    names: of those that get our terminal, too. no_deadline: of the others.
    """

    def __init__(self, names: Sequence[str] = (), no_deadline: Sequence[str] = ()) -> None:
        self._names = names
        self._no_deadline = no_deadline

    def prepare(self, scenario: Scenario) -> Scenario:
        """Raise WiringError for a name that no participant has, or that is started elsewhere."""
        names = [*self._names, *self._no_deadline]
        check_names(scenario, names, "debug")
        for name in self._names:
            if not scenario.participant(name).is_here:
                raise WiringError(
                    f"{name}: --debug is only for participants that stepbus starts on this host; "
                    f"start this one in a debugger yourself, with --no-deadline {name}"
                )
        return scenario.changed(names, **_NO_DEADLINES)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return the participant that gets the terminal."""
        return {"has_terminal": True} if spec.name in self._names else {}


def check_names(scenario: Scenario, names: Iterable[str], what: str = "") -> None:
    """Raise WiringError for a name that no participant has; what: should be done to it."""
    known = [spec.name for spec in scenario.participants]
    for name in names:
        if name not in known:
            purpose = f" to {what}" if what else ""
            raise WiringError(f"no participant {name!r}{purpose}{suggest(name, known)}")
