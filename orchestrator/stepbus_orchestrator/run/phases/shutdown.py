"""Shutdown: every process ends by itself in time, or is ended (P11.4)."""

from __future__ import annotations

import time

from stepbus_orchestrator.errors import ParticipantDied, StopTimeout
from stepbus_orchestrator.run.kernel.failures import seconds
from stepbus_orchestrator.run.kernel.participants import ParticipantState, Phase
from stepbus_orchestrator.run.loop import SHORT_TICK_S, RunLoop
from stepbus_orchestrator.scenario import Deadlines


def shut_down(loop: RunLoop, culprit: str | None) -> list[ParticipantState]:
    """End every process, take what is still reported, and return those that were late.

    Each has its stop deadline. Nobody waits for the culprit, nor for a participant that is not
    ready: it has nothing to save.
    """
    participants = loop.state.participants
    if culprit is not None and culprit in participants:
        # Before the others: a process that reads nothing blocks whoever publishes to it.
        participants[culprit].process.end()
    ready = [member for member in participants.values() if member.phase == Phase.READY]
    late = _await_ends(loop, [member for member in ready if member.name != culprit])
    for member in participants.values():
        member.process.end()
    loop.receive_after_failure(0.0)
    loop.announcer.close()
    return late


def _await_ends(loop: RunLoop, members: list[ParticipantState]) -> list[ParticipantState]:
    began = time.monotonic()
    while True:
        left = [member for member in members if member.process.exit_code() is None]
        waited_s = time.monotonic() - began
        if not any(waited_s < _patience_s(loop, member) for member in left):
            return left
        loop.announcer.repeat_stop()
        loop.receive_after_failure(SHORT_TICK_S)


def _patience_s(loop: RunLoop, member: ParticipantState) -> float:
    """Return how long a participant may take to end [s]; not long after Ctrl-C."""
    stop_s = seconds(member.spec, "stop")
    return min(stop_s, Deadlines.stop_s) if loop.controls.interrupt.is_set() else stop_s


def check_ends(loop: RunLoop, late: list[ParticipantState]) -> None:
    """Raise for a participant that did not end in time, or with another exit code than 0."""
    if late:
        raise StopTimeout(
            f"{', '.join(member.who() for member in late)} did not end within "
            f"{seconds(late[0].spec, 'stop'):g} s of the stop and was killed "
            f"(participants.{late[0].name}.stop_timeout); the recording is complete",
            participant=late[0].name,
            step=loop.state.steps,
        )
    for member in loop.state.participants.values():
        process = member.process
        if process.exit_code() != 0:
            raise ParticipantDied(
                f"after the last step: {member.who()} {process.how_it_ended()} while stopping; "
                f"the recording is complete; its log: {process.log}",
                participant=member.name,
                step=loop.state.steps,
            )
