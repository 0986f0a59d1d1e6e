"""Runs a conductor to the end, and ends every process whatever happens."""

from __future__ import annotations

from collections.abc import Callable

from stepbus_orchestrator.errors import ParticipantDied, RunFailure, StopTimeout

from .kernel.participants import Member
from .loop import Conductor


def supervise(conductor: Conductor, launch: Callable[[], None]) -> str:
    """Start the participants, conduct, and return why the run ended.

    launch: starts them and fills in the conductor's roster.

    Raises RunFailure when the run ends before its time, or a participant does not end as it
    should.
    """
    culprit = None
    try:
        launch()
        reason = conductor.conduct()
    except RunFailure as exc:
        culprit = exc.participant
        conductor.stop(str(exc))
        raise
    except BaseException:
        conductor.stop("the orchestrator ends")
        raise
    finally:
        late = conductor.end_all(culprit)
    _check_ends(conductor, late)
    return reason


def _check_ends(conductor: Conductor, late: list[Member]) -> None:
    if late:
        raise StopTimeout(
            f"{', '.join(member.who() for member in late)} did not end within "
            f"{late[0].spec.deadlines.stop_s:g} s of the stop and was killed "
            f"(participants.{late[0].name}.stop_timeout); the recording is complete",
            participant=late[0].name,
            step=conductor.steps,
        )
    for member in conductor.state.roster.values():
        if member.child.exit_code() != 0:
            raise ParticipantDied(
                f"after the last step: {member.who()} {member.child.how_it_ended()} while "
                f"stopping; the recording is complete; its log: {member.child.log}",
                participant=member.name,
                step=conductor.steps,
            )
