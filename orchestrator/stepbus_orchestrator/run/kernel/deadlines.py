"""Who is late, measured from outside (P12); the errors are in `failures`."""

from collections.abc import Mapping, Sequence

from stepbus_orchestrator.errors import StepTimeout
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_schemas import reached

from .failures import death, late_for_step, late_to_start
from .participants import PHASE_DEADLINES, Participants, ParticipantState, Phase

LAST_WORDS_S = 1.0
"""How long the last messages of a process that was ended may still be on their way [s]."""


def check_start(state: RunState, elapsed_s: float) -> None:
    """Advance the clock of all that are not ready; raises StartFailed for a late one."""
    participants = state.participants
    for participant in participants.values():
        if participant.phase == Phase.READY or _waits_for_others(participant, participants):
            continue
        participant.in_phase_s += elapsed_s
        if participant.in_phase_s > participant.limit_s(PHASE_DEADLINES[participant.phase]):
            # One that publishes to a stopped process may be blocked by it, and hears of no other.
            sources = _sources(participant, participants)
            near = (participant, *sources, *state.readers(participant.name))
            raise late_to_start(state, next(filter(_is_stopped, near), participant))


def _sources(participant: ParticipantState, others: Participants) -> list[ParticipantState]:
    """Return what a participant waits for."""
    names = () if participant.waiting is None else participant.waiting.sources
    return [others[name] for name in names if name in others]


def _waits_for_others(participant: ParticipantState, others: Participants) -> bool:
    """Return whether it waits for a handshake of a participant that is not that far yet (P4.6)."""
    return participant.phase == Phase.JOINED and any(
        source.phase < Phase.READY and source.waiting is None
        for source in _sources(participant, others)
    )


def _is_stopped(participant: ParticipantState) -> bool:
    return participant.process.activity().is_stopped


def check_step(state: RunState, elapsed_s: float) -> None:
    """Advance the clock of those that hold the step; raises StepTimeout for a late one."""
    participants, barrier = state.participants, state.barrier
    holders = barrier.holders() or [
        name for name in participants if barrier.next_step(name) <= barrier.completed
    ]
    held_by = [participants[name] for name in holders]
    for participant in held_by:
        participant.hold(state.owed_step(participant), elapsed_s)
    late = [one for one in held_by if one.holds_s > one.limit_s("step")]
    if late:
        raise late_for_step(state, _stopped(state, late) or late)


def _stopped(state: RunState, late: Sequence[ParticipantState]) -> list[ParticipantState]:
    """Return which of those that are late are stopped, or else a reader that may block one."""
    if stopped := [one for one in late if _is_stopped(one)]:
        return stopped
    for one in late:
        for reader in filter(_is_stopped, state.readers(one.name)):
            reader.hold(one.held_step, one.holds_s)
            return [reader]
    return []


def check_closing(state: RunState, elapsed_s: float) -> None:
    """Advance the clock of those whose closing outputs are missing; raises StepTimeout (P12.1)."""
    end = state.last_step
    for name in state.holders():
        participant = state.participants[name]
        code = participant.process.exit_code()
        if code is not None:
            participant.ended_s += elapsed_s
            # A participant that ended well has sent them, however busy this machine is.
            if participant.ended_s >= (LAST_WORDS_S if code else participant.limit_s("stop")):
                reached("a process has ended before its closing outputs")
                raise death(state, participant)
            continue
        participant.hold(end, elapsed_s)
        if participant.holds_s > participant.limit_s("stop"):
            reached("closing outputs are late")
            raise state.failure(
                StepTimeout,
                participant,
                end,
                f"has not published its closing outputs for {participant.holds_s:.1f} s; "
                f"deadline {participant.limit('stop')}",
            )


def check_bulk(state: RunState, owing: Mapping[str, int], waited_s: float) -> None:
    """Raise StepTimeout when announced bulk content has not come for a stop deadline.

    owing: whose it is → the first step of it.
    """
    for name, step in owing.items():
        participant = state.participants[name]
        if waited_s > participant.limit_s("stop"):
            reached("bulk content is late")
            raise state.failure(
                StepTimeout,
                participant,
                step,
                f"announced bulk content that has not arrived for {waited_s:.1f} s; deadline "
                f"{participant.limit('stop')}; was it published?",
            )
