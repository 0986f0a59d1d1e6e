"""Shutdown: every process ends by itself in time, or is ended (P11.4)."""

from collections.abc import Collection

from stepbus_orchestrator.errors import ParticipantDied, RunFailure, StopTimeout
from stepbus_orchestrator.processes.child import TERM_GRACE_S
from stepbus_orchestrator.run.kernel.failures import seconds
from stepbus_orchestrator.run.kernel.participants import ParticipantState, Phase
from stepbus_orchestrator.run.run import SHORT_TICK_S, Run
from stepbus_orchestrator.scenario.model import Deadlines
from stepbus_participant import Clock

_LAST_S = 0.5
"""How long the last messages of a process may come behind its end [s]."""
_LEAVE_S = 1.0
"""How long a run that has failed waits for a process that somebody else has started [s]."""


def shut_down(run: Run, failure: RunFailure | None) -> list[ParticipantState]:
    """End every process, take what is still reported, and return those that were late.

    Each has its stop deadline. Nobody waits for the culprit, nor for a participant that is not
    ready: it has nothing to save.
    """
    participants = run.state.participants
    culprit = None if failure is None else failure.participant
    if culprit is not None and culprit in participants and not _is_external(participants[culprit]):
        # Before the others: a process that reads nothing blocks those that publish to it.
        participants[culprit].process.end()
    waits_for = [
        participant
        for participant in participants.values()
        if participant.phase == Phase.READY
        and (participant.name != culprit or _is_external(participant))
        # In a run that has failed, one that is stopped as well would only be waited for.
        and not (failure is not None and participant.process.activity().is_stopped)
    ]
    late = _await_ends(run, waits_for, has_failed=failure is not None)
    _end_all(run.clock, participants.values())
    _take_last(run, waits_for)
    run.announcer.close()
    return late


def _take_last(run: Run, participants: Collection[ParticipantState]) -> None:
    """Take what participants published before they ended; it may arrive after their exit codes."""
    give_up = run.clock.monotonic() + _LAST_S
    run.receive_after_failure(0.0)
    while run.clock.monotonic() < give_up and not all(
        participant.has_left or _is_external(participant) for participant in participants
    ):
        run.receive_after_failure(SHORT_TICK_S)


def _end_all(clock: Clock, participants: Collection[ParticipantState]) -> None:
    for participant in participants:
        participant.process.terminate()
    # They share the grace between the two signals.
    give_up = clock.monotonic() + TERM_GRACE_S
    for participant in participants:
        participant.process.end(max(0.0, give_up - clock.monotonic()))


def _is_external(participant: ParticipantState) -> bool:
    return participant.external is not None


def _await_ends(
    run: Run, participants: list[ParticipantState], *, has_failed: bool
) -> list[ParticipantState]:
    began = run.clock.monotonic()
    while True:
        left = [
            participant for participant in participants if participant.process.exit_code() is None
        ]
        waited_s = run.clock.monotonic() - began
        if not any(waited_s < _patience_s(run, item, has_failed=has_failed) for item in left):
            return left
        run.extensions.awaiting(left)
        for participant in left:
            participant.process.limit_log()
        run.announcer.repeat_stop()
        run.receive_after_failure(SHORT_TICK_S)


def _patience_s(run: Run, participant: ParticipantState, *, has_failed: bool) -> float:
    """Return how long a participant may take to end [s]; not long after Ctrl-C."""
    if has_failed and _is_external(participant):
        # It may stand in a debugger, and nobody may end it.
        return _LEAVE_S
    stop_s = seconds(participant.spec, "stop")
    return min(stop_s, Deadlines.stop_s) if run.interrupt.is_set() else stop_s


def check_ends(run: Run, late: list[ParticipantState]) -> None:
    """Raise for a participant that did not end in time, or with another exit code than 0."""
    participants = run.state.participants.values()
    late = [*late, *(item for item in participants if item.process.late is not None)]
    if late:
        raise StopTimeout(
            f"{', '.join(participant.who() for participant in late)} did not end within "
            f"{seconds(late[0].spec, 'stop'):g} s of the stop and was "
            f"{'left alone' if _is_external(late[0]) else 'killed'} "
            f"(participants.{late[0].name}.stop_timeout); the recording is complete",
            participant=late[0].name,
            step=run.state.steps,
        )
    for participant in participants:
        process = participant.process
        if process.exit_code() != 0:
            raise ParticipantDied(
                f"after the last step: {participant.who()} {process.how_it_ended()} while "
                f"stopping; the recording is complete; {participant.where_it_prints()}",
                participant=participant.name,
                step=run.state.steps,
            )
