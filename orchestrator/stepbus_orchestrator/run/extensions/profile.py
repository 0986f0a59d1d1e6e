"""Measures where the time of each step goes."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import ProfileOrder, make_new_folder

from .debug import check_names

if TYPE_CHECKING:
    from stepbus_orchestrator.run.run import Run

PROFILE_FOLDER = "profile"
"""In the folder of a run: a CSV for each participant, and what was sampled."""


class Profile(RunExtension):
    """Lets each participant measure its steps. sampled: whose stack is sampled too."""

    def __init__(self, sampled: Sequence[str] = ()) -> None:
        self._sampled = list(sampled)

    def prepare(self, scenario: Scenario) -> Scenario:
        """Raise WiringError for a name that no participant has."""
        check_names(scenario, self._sampled, "sample")
        return scenario

    def attach(self, run: "Run") -> None:
        """Make the folder."""
        super().attach(run)
        make_new_folder(run.out / PROFILE_FOLDER)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return what a participant measures."""
        folder = self.run.out.resolve() / PROFILE_FOLDER
        return {"profile": ProfileOrder(folder=str(folder), sampled=self._sampled)}
