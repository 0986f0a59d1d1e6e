"""What a run reports to its observer, which has no effect on it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol


@dataclass(frozen=True, kw_only=True)
class Progress:
    """A moment of a run.

    phase: `starting`, `stepping`, `paused` or `stopping`. step, steps: completed and in all (None:
    open end). phases: of each participant. compute_us: mean computing time of each
    participant's step [µs]. drops: messages each participant has dropped. angles: newest measured
    angle of each joint [rad].
    """

    phase: str
    step: int
    steps: int | None
    step_ns: int
    elapsed_s: float
    phases: Mapping[str, str]
    compute_us: Mapping[str, float]
    drops: Mapping[str, int]
    holders: tuple[str, ...]
    angles: Mapping[str, float] = field(default_factory=dict)


class Observer(Protocol):
    """Watches a run; called on the run's own thread, so it must be quick."""

    def progress(self, progress: Progress) -> None:
        """Take how far the run is; called about four times a second."""

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Take a sentence for the user."""


class Silent:
    """An observer that ignores everything."""

    def progress(self, progress: Progress) -> None:
        """Ignore it."""

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Ignore it."""
