"""Who is late, measured from outside (P12); the sentences are in `failures`."""

from collections.abc import Sequence

from stepbus_orchestrator.run.kernel.state import RunState

from .failures import (
    death,
    late_for_step,
    late_to_close,
    late_to_start,
    missing_bulk,
    owed_step,
    seconds,
)
from .participants import PHASE_DEADLINES, Participants, ParticipantState, Phase

LAST_WORDS_S = 1.0
"""How long the last messages of a process that was ended may still be on their way [s]."""


def check_start(participants: Participants, elapsed_s: float) -> None:
    """Advance the clock of all who are not ready; raises StartFailed for one who is late."""
    for participant in participants.values():
        if participant.phase == Phase.READY or _waits_for_others(participant, participants):
            continue
        participant.in_phase_s += elapsed_s
        if participant.in_phase_s > seconds(participant.spec, PHASE_DEADLINES[participant.phase]):
            raise late_to_start(_cause(participant, participants))


def _cause(late: ParticipantState, participants: Participants) -> ParticipantState:
    """Return who keeps one from being ready: a stopped one that it waits for, or itself."""
    sources = () if late.waiting is None else late.waiting.sources
    awaited = [participants[name] for name in sources if name in participants]
    stopped = (source for source in awaited if source.process.activity().is_stopped)
    return next(stopped, late)


def _waits_for_others(participant: ParticipantState, participants: Participants) -> bool:
    """Return whether it waits for a handshake of a participant that is not that far yet (P4.6)."""
    if participant.phase != Phase.JOINED or participant.waiting is None:
        return False
    sources = [participants[name] for name in participant.waiting.sources if name in participants]
    return any(source.phase < Phase.READY and source.waiting is None for source in sources)


def check_step(state: RunState, elapsed_s: float) -> None:
    """Advance the clock of those who hold the step; raises StepTimeout for one who is late."""
    participants, barrier = state.participants, state.barrier
    holders = barrier.holders() or [
        name for name in participants if barrier.next_step(name) <= barrier.completed
    ]
    held_by = [participants[name] for name in holders]
    for participant in held_by:
        participant.hold(owed_step(participant.name, participants, barrier), elapsed_s)
    late = [
        participant
        for participant in held_by
        if participant.holds_s > seconds(participant.spec, "step")
    ]
    # A publisher to a stopped process may be blocked by it.
    late = [
        participant for participant in late if participant.process.activity().is_stopped
    ] or late
    if late:
        raise late_for_step(late, barrier, state.scenario.step_ns)


def check_closing(state: RunState, closing: Sequence[str], elapsed_s: float) -> None:
    """Advance the clock of those whose closing outputs are missing; raises StepTimeout (P12.1)."""
    end, step_ns = state.last_step, state.scenario.step_ns
    for name in closing:
        if state.barrier.reported[name] >= end:
            continue
        participant = state.participants[name]
        code = participant.process.exit_code()
        if code is not None:
            participant.ended_s += elapsed_s
            # Who ended well has sent them, however busy this machine is.
            patience_s = LAST_WORDS_S if code else seconds(participant.spec, "stop")
            if participant.ended_s < patience_s:
                continue
            raise death(participant, state.participants, state.barrier, step_ns)
        participant.hold(end, elapsed_s)
        if participant.holds_s > seconds(participant.spec, "stop"):
            raise late_to_close(participant, end, step_ns)


def check_bulk(state: RunState, waited_s: float) -> None:
    """Raise StepTimeout when announced bulk content has not come for the longest stop deadline."""
    deadline_s = max(
        seconds(participant.spec, "stop") for participant in state.participants.values()
    )
    if waited_s > deadline_s:
        raise missing_bulk(state.last_step, waited_s, deadline_s, state.scenario.step_ns)
