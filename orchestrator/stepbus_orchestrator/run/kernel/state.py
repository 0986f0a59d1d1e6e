"""The state of a run: its phase, how far it is, when it ends, who takes part."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, TypeVar

from stepbus_orchestrator.errors import RunFailure, StartFailed, indented
from stepbus_orchestrator.run.kernel.admission import max_message_bytes
from stepbus_orchestrator.run.kernel.barrier import FAR, Barrier
from stepbus_orchestrator.run.kernel.participants import Participants, ParticipantState, Phase
from stepbus_orchestrator.scenario.model import Scenario, low_latency
from stepbus_schemas import due_step

_Failure = TypeVar("_Failure", bound=RunFailure)


def at(step: int, step_ns: int) -> str:
    """Return `step 1042 (t = 5.210 s)`, or `before the first step`."""
    if step < 0:
        return "before the first step"
    return f"step {step} (t = {step * step_ns * 1e-9:.3f} s)"


class RunPhase(StrEnum):
    """What a run is doing.

    Start-up: participants join, load their models and get ready (P4). Stepping: steps are released
    (P5). Fallback: the same, with messages published for a participant that has failed. Closing:
    closing outputs come in (P11.3). Shutdown: processes end (P11.4).
    """

    START_UP = "start-up"
    STEPPING = "stepping"
    FALLBACK = "fallback"
    CLOSING = "closing"
    SHUTDOWN = "shutdown"

    @property
    def is_stepping(self) -> bool:
        """Return whether steps are released."""
        return self is RunPhase.STEPPING or self is RunPhase.FALLBACK

    @property
    def is_stopping(self) -> bool:
        """Return whether participants have been asked to end."""
        return self is RunPhase.CLOSING or self is RunPhase.SHUTDOWN

    @property
    def shown(self) -> str:
        """Return the phase as users see it: `starting`, `stepping` or `stopping`."""
        if self is RunPhase.START_UP:
            return "starting"
        return "stepping" if self.is_stepping else "stopping"


@dataclass
class RunState:
    """How far a run is.

    participants: those whose processes have been started. released: the newest trigger; steps
    below it may be worked on. unauthenticated: how many messages were dropped. end: the step
    before which the run ends, and why, once it was requested. compute: participant →
    total computing time [ns] and number of steps. waited: participant → its total waiting time
    [ns] in these. newest: of each participant, port → its last message. started_at: when the first
    trigger was sent, by the monotonic clock [s]. replaced: those that failed and are replaced by
    their fallback. is_repeating: whether the steps are those of a recording still. is_paused:
    whether the user holds the run. ends_from:
    participants whose requests to end count from a step on only, with that step. closing: those
    that publish closing outputs (P11.3), once the run is over. away_s: how long
    no participant worked, since code of this process did something else [s]. is_check_due,
    is_release_due: whether processes, or the gates, are to be checked at once.
    """

    scenario: Scenario
    barrier: Barrier = field(init=False)
    participants: Participants = field(default_factory=dict)
    phase: RunPhase = RunPhase.START_UP
    released: int = 0
    unauthenticated: int = 0
    end: tuple[int, str] | None = None
    compute: dict[str, tuple[int, int]] = field(default_factory=dict)
    waited: dict[str, int] = field(default_factory=dict)
    newest: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    started_at: float = 0.0
    replaced: str | None = None
    is_repeating: bool = False
    is_paused: bool = False
    ends_from: Mapping[str, int] = field(default_factory=dict)
    closing: Sequence[str] = ()
    away_s: float = 0.0
    is_check_due: bool = False
    is_release_due: bool = False

    def __post_init__(self) -> None:
        self.barrier = Barrier(self.scenario)

    def enter(self, phase: RunPhase) -> None:
        """Enter a phase."""
        self.phase = phase

    def ask_end(self, step: int, reason: str) -> None:
        """End the run before a step; of several requests, the earliest counts (P7.4)."""
        asked = (step, indented(reason))
        self.end = asked if self.end is None else min(self.end, asked)

    def waited_us(self) -> dict[str, float]:
        """Return the mean time that each participant waits in a step [µs]."""
        return {
            name: self.waited.get(name, 0) / count * 1e-3
            for name, (_, count) in self.compute.items()
            if count
        }

    @property
    def last_step(self) -> int:
        """Return the number of steps of this run, as far as it is known."""
        if self.end is not None:
            return self.end[0]
        return FAR if self.scenario.steps is None else self.scenario.steps

    @property
    def reason(self) -> str:
        """Return why the run ends, where nothing failed."""
        return "finished" if self.end is None else self.end[1]

    @property
    def steps(self) -> int:
        """Return how many steps of the run are complete."""
        return min(max(0, self.barrier.completed), self.last_step)

    @property
    def is_complete(self) -> bool:
        """Return whether all steps of the run are complete."""
        return self.barrier.completed >= self.last_step

    @property
    def is_held(self) -> bool:
        """Return whether all released steps are done, and a gate holds the run."""
        return self.barrier.completed >= self.released

    @property
    def is_ready(self) -> bool:
        """Return whether every participant is ready."""
        return all(participant.phase == Phase.READY for participant in self.participants.values())

    def at(self, step: int) -> str:
        """Return `step 1042 (t = 5.210 s)`."""
        return at(step, self.scenario.step_ns)

    def owed_step(self, participant: ParticipantState) -> int:
        """Return the step whose output a participant owes; −1 before it is ready.

        Its own reports lag behind by up to a log batch; those that wait for it are ahead (P9.3).
        """
        if participant.phase != Phase.READY:
            return -1
        name, every, newest = participant.name, participant.spec.every, participant.newest()
        owed = max(self.barrier.next_step(name), newest + every if newest >= 0 else 0)
        for other in self.participants.values():
            waiting = other.waiting
            if waiting is not None and name in waiting.sources:
                delays = [item.delay for item in other.spec.inputs.values() if item.source == name]
                owed = max(owed, due_step(waiting.step, min(delays), every))
        return owed

    def is_awaited(self, name: str) -> bool:
        """Return whether each reader of a participant has reported that it waits, or has ended."""
        return all(
            reader.waiting is not None or reader.process.exit_code() is not None
            for reader in self.readers(name)
        )

    def holders(self) -> list[str]:
        """Return the participants that hold the oldest incomplete step, or the end of the run."""
        if not self.is_complete:
            return self.barrier.holders()
        return [name for name in self.closing if self.barrier.reported[name] < self.last_step]

    def readers(self, name: str) -> list[ParticipantState]:
        """Return the participants that read outputs of one."""
        return [
            one
            for one in self.participants.values()
            if any(item.source == name for item in one.spec.inputs.values())
        ]

    def failure(
        self, kind: type[_Failure], participant: ParticipantState, step: int, what: str
    ) -> _Failure:
        """Return the failure of a participant: at which step, who, what it did."""
        text = f"{self.at(step)}: {participant.who()} {what}"
        return kind(text, participant=participant.name, step=step)

    def check_size(self, what: str, data: bytes) -> None:
        """Raise StartFailed for what the low-latency transport would silently lose (P3.7)."""
        limit = max_message_bytes(self.scenario)
        if len(data) > limit:
            raise StartFailed(
                f"before the first step: {what} take {len(data)} bytes, more than the "
                f"{limit} that the low-latency transport can carry; set bus.low_latency: "
                "false"
            )

    def check_bulk(self, slots: Collection[str]) -> None:
        """Raise StartFailed for bulk content in messages that the transport may lose (P3.7).

        slots: the outputs, `<participant>.<port>`, whose content is not in messages.
        """
        bulk = [
            f"{spec.name}.{port}"
            for spec in self.scenario.participants
            for port, output in spec.outputs.items()
            if output.bulk
        ]
        lost = [output for output in bulk if output not in slots]
        if lost and low_latency(self.scenario):
            raise StartFailed(
                f"before the first step: the content of {', '.join(lost)} travels in messages "
                "here, of which the low-latency transport loses those over 64 KiB; set "
                "bus.low_latency: false"
            )
