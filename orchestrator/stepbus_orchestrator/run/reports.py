"""What a run reports: progress, events and lateness; none of it has an effect on the run."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import msgspec

from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.kernel.descriptions import newest_of
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_schemas import Event, JointState


def _measured_angles(state: RunState, descriptions: Descriptions) -> dict[str, float]:
    """Return joint → its newest angle [rad]; prismatic joints have none."""
    angles: dict[str, float] = {}
    measured = newest_of(JointState, state.scenario, descriptions, state.newest)
    for _, message, described in measured:
        types = described.details.get("type") or [""] * len(described.names)
        rows = zip(described.names, types, message.position or (), strict=False)
        angles |= {name: angle for name, joint, angle in rows if joint != "prismatic"}
    return angles


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Progress of a run.

    phase: `starting`, `stepping`, `paused` or `stopping`. step, steps: completed steps and their
    planned number (None: no fixed end). phases: phase of each participant. compute_us: mean
    computing time of each participant's step [µs]. drops: messages each participant has dropped.
    angles: newest measured angle of each joint [rad].
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


class Observer:
    """Receives progress and events of a run, on the run's thread, so it must return quickly."""

    def progress(self, progress: Progress) -> None:
        """Receive the progress of the run; called about four times a second."""

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Receive an event as a text for the user."""

    def compared(self, step: int, lines: Callable[[], list[str]]) -> None:
        """Receive a step of a replay. lines: returns each output in words, beside the recorded."""


def progress_of(
    state: RunState, descriptions: Descriptions, elapsed_s: float, *, is_held: bool
) -> Progress:
    """Return how far a run is; is_held: whether it is, wherever all released steps are done."""
    participants = state.participants.values()
    # At the end of a run, all steps are done and nothing is to come.
    has_more = state.steps != state.scenario.steps
    is_paused = state.phase.is_stepping and state.is_held and is_held and has_more
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
        angles=_measured_angles(state, descriptions),
    )


# More than that from one output is noise; the recording has them all.
_MOST_SHOWN = 50


_FEW = 5
"""Fewer firings do not show that an output is silent."""

_OCCASIONAL = frozenset(
    (
        *("BaseCommand/1", "Bytes/1", "Detections/1", "Event/1", "Goal/1", "GoalStatus/1"),
        *("GripperCommand/1", "Image/1", "Plan/1", "PlanRequest/1", "Text/1"),
    )
)
"""Types of which a run may have no message."""


class Warned(msgspec.Struct, frozen=True, kw_only=True):
    """A warning or an error that a participant reported.

    source: `participant.output`. step: at which it was published. text: one sentence.
    """

    source: str
    step: int
    level: str
    text: str


class Events:
    """Takes every recorded event, in the order of the recording, and shows it.

    observer: shows it. warnings: the first ones of each output; count: of all.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._shown: dict[str, int] = {}
        self.warnings: list[Warned] = []
        self.count = 0

    def take(self, participant: str, port: str, step: int, event: Event) -> None:
        """Take an event; each line of its text is a sentence of its own."""
        for text in filter(None, event.text.splitlines()):
            self._take_line(f"{participant}.{port}", participant, step, event.level, text)

    def add_warning(self, source: str, text: str) -> None:
        """Add a warning of the orchestrator itself."""
        self._take_line(source, "orchestrator", 0, "warning", text)

    def add_silent(self, scenario: Scenario, silent: Collection[tuple[str, str]], end: int) -> None:
        """Warn about outputs that never published in a run of so many steps."""
        for spec in scenario.participants:
            if end // spec.every < _FEW:
                continue
            for port, output in spec.outputs.items():
                if (spec.name, port) in silent and output.type not in _OCCASIONAL:
                    text = f"never published in {end} steps ({output.type})"
                    self._take_line(f"{spec.name}.{port}", spec.name, end, "warning", text)

    def _take_line(self, source: str, who: str, step: int, level: str, text: str) -> None:
        self._shown[source] = self._shown.get(source, 0) + 1
        is_shown = self._shown[source] <= _MOST_SHOWN
        if level != "info":
            self.count += 1
            if is_shown:
                self.warnings.append(Warned(source=source, step=step, level=level, text=text))
        if is_shown:
            self._observer.event(level, who, step, text)
        elif self._shown[source] == _MOST_SHOWN + 1:
            self._observer.event(
                "info", who, step, f"further events of {source} are only in the recording"
            )


_UNITS = (("s", 1e6), ("ms", 1e3), ("µs", 1.0))
_KEPT = 0.95
"""A share of the asked speed below it is worth a word."""


class Lateness(msgspec.Struct, frozen=True, kw_only=True):
    """How late the steps of a run began, by the wall clock.

    factor: simulated over wall time that was asked for. steps: that began. p50_us, p99_us, max_us:
    of their lateness [µs]. histogram: lateness up to [µs] → steps; `more`: the rest. late:
    participant → how many steps it held past the next grid point. kept: share of the speed that was
    asked for, up to the last step; behind_s: how late that was [s].
    """

    factor: float
    steps: int
    p50_us: float
    p99_us: float
    max_us: float
    histogram: Mapping[str, int]
    late: Mapping[str, int]
    kept: float = 1.0
    behind_s: float = 0.0

    def complaint(self) -> str:
        """Return what to say of a run that did not keep the time it was asked for; or nothing."""
        if self.kept >= _KEPT:
            return ""
        held = ", ".join(f"{count} by {name}" for name, count in self.late.items()) or "none"
        reached = self.factor * self.kept
        return (
            f"real time was not kept: {reached:.2f} instead of {self.factor:g}; the last "
            f"step was {self.behind_s:.1f} s late (late steps: {held})"
        )


def in_units(us: float) -> str:
    """Return a duration as people read it: µs, ms or s, with three digits. us: [µs]."""
    unit, size = next((row for row in _UNITS if us >= row[1]), _UNITS[-1])
    return f"{float(f'{us / size:.3g}'):g} {unit}"
