"""How a goal has ended, as whoever carried it out tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The end of a goal.

    cause: one word for programs, empty where all is well. text: one sentence for people.
    """

    state: Literal["succeeded", "failed"]
    cause: str = ""
    text: str = ""
