"""The seam between a run and whatever becomes of its outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from stepbus_orchestrator.run.kernel.participants import Descriptions
from stepbus_schemas import CallRecord, Outputs


class Sink(Protocol):
    """Takes the outputs of participants: a recorder, or a comparison with a recording."""

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Learn what the participants say of their outputs, and what they run on."""

    def note(self, name: str, content: Mapping[str, str]) -> None:
        """Learn something about the run that is no message."""

    def note_call(self, call: CallRecord) -> None:
        """Learn of a call that changed something; all steps before its own are written."""

    def offer(self, name: str, outputs: Outputs) -> None:
        """Take the outputs of one participant, which come in the order of their steps."""

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Take the content of a bulk port, before or after the outputs that announce it."""

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""

    def write_below(self, step: int) -> None:
        """Learn that all steps below `step` are complete."""

    def finish(self, closing_step: int, closing: list[str]) -> None:
        """Learn that the run ended before `closing_step`, and who published once more at it."""
