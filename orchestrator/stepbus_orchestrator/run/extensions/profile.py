"""Measures where the time of each step goes."""

from collections.abc import Mapping
from typing import Any

from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import ProfileOrder, make_new_folder

PROFILE_FOLDER = "profile"
"""In the folder of a run: a CSV for each participant."""


class Profile(RunExtension):
    """Lets each participant measure its steps."""

    def attach(self, run: RunView) -> None:
        """Make the folder."""
        super().attach(run)
        make_new_folder(run.out / PROFILE_FOLDER)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return where a participant writes what it measures."""
        return {"profile": ProfileOrder(folder=str(self.run.out.resolve() / PROFILE_FOLDER))}
