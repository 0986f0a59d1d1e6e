"""How a goal ends, and why one is refused."""

from dataclasses import dataclass
from typing import Literal

from stepbus_schemas import RunError


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The end of a goal.

    cause: one word for programs, empty for success. text: one sentence for people.
    """

    state: Literal["succeeded", "failed"]
    cause: str = ""
    text: str = ""


FARTHEST = 1e4
"""Largest length [m] and angle [rad] of a goal; beyond it numbers overflow."""


class Refused(RunError):
    """A goal that cannot be carried out; cause: one word for programs."""

    def __init__(self, cause: str, text: str) -> None:
        super().__init__(text)
        self.cause = cause


def failure_of(error: RunError) -> Outcome:
    """Return how a goal ends that cannot be carried out."""
    cause = error.cause if isinstance(error, Refused) else "invalid"
    return Outcome(state="failed", cause=cause, text=str(error))
