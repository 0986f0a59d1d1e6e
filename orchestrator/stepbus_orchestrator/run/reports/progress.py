"""What a run reports to its observer, which has no effect on it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.kernel.state import RunState

from .angles import measured_angles


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


def progress_of(
    state: RunState, descriptions: Descriptions, elapsed_s: float, *, is_held: bool
) -> Progress:
    """Return how far a run is; is_held: whether it is, wherever all released steps are done."""
    participants = state.participants.values()
    is_paused = state.phase.is_stepping and state.is_held and is_held
    is_moving = state.phase.is_stepping and not is_paused
    return Progress(
        phase="paused" if is_paused else state.phase.shown,
        step=state.steps,
        steps=state.scenario.steps,
        step_ns=state.scenario.step_ns,
        elapsed_s=elapsed_s,
        phases={item.name: item.phase.name.lower() for item in participants},
        compute_us={name: total / count * 1e-3 for name, (total, count) in state.compute.items()},
        drops={item.name: sum(item.drops.values()) for item in participants},
        holders=tuple(state.barrier.holders()) if is_moving and not state.is_held else (),
        angles=measured_angles(state.scenario, descriptions, state.newest),
    )
