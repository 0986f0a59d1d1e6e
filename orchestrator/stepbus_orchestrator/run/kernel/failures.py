"""The failures of a run, each with its error: who, at which step, the numbers, what to check."""

from stepbus_orchestrator.errors import ParticipantDied, RunFailure, StartFailed, StepTimeout
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_schemas import reached

from .participants import PHASE_DEADLINES, ParticipantState, Phase


def late_to_start(state: RunState, participant: ParticipantState) -> StartFailed:
    """Return the failure of a participant that is not ready in time, or keeps others from it."""
    phase = PHASE_DEADLINES.get(participant.phase, "ready")
    what, why = _start(participant, phase)
    pid = participant.process.pid
    # A child leads a group of its own, to which the user may send a signal.
    target = -pid if participant.external is None else pid
    activity = participant.process.activity()
    silence = participant.process.silence()
    cause = f"{silence}." if silence else activity.reason(target, participant.in_phase_s)
    return state.failure(
        StartFailed,
        participant,
        -1,
        f"{what}; {cause or why} It had {participant.limit(phase)}; "
        f"{participant.where_it_prints()}",
    )


def _start(participant: ParticipantState, phase: str) -> tuple[str, str]:
    """Return what a participant has not done in time, and what to check."""
    waiting = participant.waiting
    if participant.phase == Phase.READY:
        reached("a participant that is ready does not answer its peers")
        return "is ready, but does not answer its peers", "is it stuck?"
    if phase == "spawn" and participant.external is not None:
        return "has not joined", f"did you start it with `{participant.external.command}`?"
    if phase == "spawn":
        reached("a program has not reached the bus")
        return "has not reached the bus", "does its program take part with stepbus?"
    if phase == "join":
        reached("a participant has not asked to join")
        return "has reached the bus, but has not asked to join", "is it stuck?"
    if waiting is not None:
        reached("a participant is not connected to a source")
        sources = ", ".join(waiting.sources)
        return f"is not connected to {sources}, which is running", "can the two reach each other?"
    reached("a participant is not ready")
    loading = "is its model still loading?"
    if participant.spec.bridge is not None:
        loading += " Does it write its answers to descriptor 4, and flush them?"
    return f"has joined and {_worker(participant)}is not ready", loading


def _worker(participant: ParticipantState) -> str:
    """Return the program behind a bridge, which does the participant's work."""
    return "" if participant.spec.bridge is None else f"`{' '.join(participant.spec.exec)}` "


def late_for_step(state: RunState, late: list[ParticipantState]) -> StepTimeout:
    """Return the failure of the participants that hold a step past their deadline."""
    first = late[0]
    # One that publishes first owes the outputs of the next step when it waits for inputs of this.
    step = first.held_step
    if first.waiting is not None and first.waiting.sources and _waits_in_held_step(first):
        step = first.waiting.step
    when = state.at(step)
    what = "; ".join(
        f"{one.who()} {_silence(one) or _holds(state, one)} deadline {one.limit('step')}"
        for one in late
    )
    return StepTimeout(f"{when}: {what}", participant=first.name, step=step)


def _waits_in_held_step(participant: ParticipantState) -> bool:
    ahead = participant.spec.every if participant.spec.publishes == "first" else 0
    waiting = participant.waiting
    return waiting is not None and waiting.step + ahead == participant.held_step


def _silence(participant: ParticipantState) -> str:
    """Return that the host of a participant is out of reach; empty: it is not."""
    silence = participant.process.silence()
    return f"holds the step for {participant.holds_s:.1f} s: {silence};" if silence else ""


def _holds(state: RunState, participant: ParticipantState) -> str:
    """Return why a participant holds the step, as far as the orchestrator can see it."""
    held = f"{participant.holds_s:.1f} s"
    missing = state.barrier.missing(participant.name)
    waiting = participant.waiting
    if participant.process.activity().is_stopped:
        reached("a stopped participant holds the step")
        return f"has been stopped by a signal or a debugger, and has held the step for {held};"
    if missing:
        reached("a participant waits for one that owes the step")
        return f"still waits for {', '.join(missing)};"
    if waiting is not None and waiting.sources and _waits_in_held_step(participant):
        reached("a participant waits for what was published")
        return (
            f"has been waiting for {', '.join(waiting.sources)} for {held}, whose outputs were "
            f"published; was a message lost or dropped? It reports {_drops(participant)};"
        )
    if waiting is not None and participant.missed_trigger:
        reached("a participant misses a trigger")
        return (
            f"has held the step for {held}: it reports that it is waiting for the "
            f"trigger of step {waiting.step}, which was sent, and {_drops(participant)}; "
            "does it read `step_limit` (docs/protocol.md, P5.1)?"
        )
    if participant.spec.bridge is not None:
        return (
            f"has been waiting for {_worker(participant)}for {held}; all inputs have arrived; "
            "does it answer every message, and flush the answer?"
        )
    reached("a participant computes too long")
    drops = f"; it reports {_drops(participant)}" if participant.drops else ""
    return f"has been computing for {held}; all inputs have arrived{drops};"


def _drops(participant: ParticipantState) -> str:
    """Return how many messages it has dropped: `3 dropped messages (2 stale, 1 duplicate)`."""
    causes = ", ".join(f"{count} {cause}" for cause, count in participant.drops.items())
    total = sum(participant.drops.values())
    return f"{total} dropped message{'s' * (total != 1)}" + (f" ({causes})" if causes else "")


def death(state: RunState, participant: ParticipantState) -> RunFailure:
    """Return the failure of a participant whose process has ended (P10.4), or that we have ended.

    One that read nothing any more was killed; one that shares our thread kept it too long.
    """
    process, is_ready = participant.process, participant.phase == Phase.READY
    kind: type[RunFailure] = StepTimeout if is_ready else StartFailed
    prints = participant.where_it_prints()
    if participant.took_nothing:
        reached("a participant reads nothing")
        kind = StepTimeout
        what = (
            f"has read no messages for {participant.limit_s('step'):g} s while they queued "
            f"up; deadline {participant.limit('step')}"
        )
    elif process.late:
        deadline = participant.limit("step" if is_ready else "ready")
        what = f"has been {process.late}; deadline {deadline}; {prints}"
    else:
        reached("a process has ended before the run")
        kind = ParticipantDied if is_ready else StartFailed
        output = process.last_output()
        words = f'; its last output: "{output}"' if output else ""
        what = f"{process.how_it_ended()}{words}; {prints}"
    return state.failure(kind, participant, state.owed_step(participant), what)
