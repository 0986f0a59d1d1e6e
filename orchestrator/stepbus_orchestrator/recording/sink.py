"""The seam between a run and what becomes of its outputs."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from stepbus_schemas import CallRecord, Description, Outputs

Descriptions = Mapping[str, Mapping[str, Description]]
"""Participant → output → its description."""


class Sink(Protocol):
    """Takes the outputs of participants: a recorder, or a comparison with a recording."""

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Take how the participants describe their outputs, and what they run on."""

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Take a fact about the run that is no message."""

    def add_call(self, call: CallRecord) -> None:
        """Take a call that changed something; all steps before its own are written."""

    def offer(self, name: str, outputs: Outputs) -> None:
        """Take the outputs of one participant, which come in the order of their steps."""

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Take the content of a bulk port, before or after the outputs that announce it."""

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""

    def write_below(self, step: int) -> None:
        """Process all steps below `step`: they are complete."""

    def flush(self) -> None:
        """Keep what is processed safe from a kill; called by the wall clock, changes no result."""

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """End at `closing_step`; closing: who published once more at it."""
