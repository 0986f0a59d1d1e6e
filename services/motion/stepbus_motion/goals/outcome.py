"""How a goal has ended, as whoever carried it out tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from stepbus_schemas import RunError


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The end of a goal.

    cause: one word for programs, empty where all is well. text: one sentence for people.
    """

    state: Literal["succeeded", "failed"]
    cause: str = ""
    text: str = ""


class Refused(RunError):
    """A goal that cannot be carried out; cause: one word for programs."""

    def __init__(self, cause: str, text: str) -> None:
        super().__init__(text)
        self.cause = cause


@dataclass(frozen=True, kw_only=True)
class Settling:
    """When a motion counts as done.

    position: largest error of a joint [rad]. velocity: largest that still counts as still [rad/s].
    steps: so many in a row. timeout: after the end of the motion [s].
    """

    position: float
    velocity: float
    steps: int
    timeout: float
