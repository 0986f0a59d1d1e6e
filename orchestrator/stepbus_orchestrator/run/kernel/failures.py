"""The failures of a run, each with its sentence: who, at which step, the numbers, what to check."""

from stepbus_orchestrator.errors import (
    ParticipantDied,
    ParticipantFault,
    RunFailure,
    StartFailed,
    StepTimeout,
)
from stepbus_orchestrator.run.kernel.barrier import Barrier
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_schemas import due_step

from .participants import PHASE_DEADLINES, KeptThread, Participants, ParticipantState, Phase


def at(step: int, step_ns: int) -> str:
    """Return `step 1042 (t = 5.210 s)`, or `before the first step`."""
    if step < 0:
        return "before the first step"
    return f"step {step} (t = {step * step_ns * 1e-9:.3f} s)"


def seconds(spec: ParticipantSpec, phase: str) -> float:
    """Return one of a participant's deadlines [s]."""
    value: float = getattr(spec.deadlines, f"{phase}_s")
    return value


def deadline(spec: ParticipantSpec, phase: str) -> str:
    """Return a deadline as error messages give it: `deadline 3 s (participants.a.step_timeout)`."""
    return f"deadline {_limit(spec, phase)}"


def _limit(spec: ParticipantSpec, phase: str) -> str:
    return f"{seconds(spec, phase):g} s (participants.{spec.name}.{phase}_timeout)"


def owed_step(name: str, participants: Participants, barrier: Barrier) -> int:
    """Return the step whose output a participant owes.

    Its own reports lag behind by up to a log batch; those that wait for it are ahead (P9.3).
    """
    every = participants[name].spec.every
    newest = participants[name].newest()
    owed = max(barrier.next_step(name), newest + every if newest >= 0 else 0)
    for other in participants.values():
        waiting = other.waiting
        if waiting is not None and name in waiting.sources:
            delays = [item.delay for item in other.spec.inputs.values() if item.source == name]
            owed = max(owed, due_step(waiting.step, min(delays), every))
    return owed


def late_to_start(participant: ParticipantState) -> StartFailed:
    """Return the failure of a participant that is not ready in time, or keeps others from it."""
    phase = PHASE_DEADLINES.get(participant.phase, "ready")
    what, why = _start(participant, phase)
    activity = participant.process.activity()
    cause = activity.reason(_target(participant), participant.in_phase_s)
    return StartFailed(
        f"before the first step: {participant.who()} {what}; {cause or why} "
        f"It had {_limit(participant.spec, phase)}; {participant.where_it_prints()}",
        participant=participant.name,
    )


def _target(participant: ParticipantState) -> int:
    """Return where to send a signal by hand: a child leads a group of its own."""
    pid = participant.process.pid
    return -pid if participant.external is None else pid


def _start(participant: ParticipantState, phase: str) -> tuple[str, str]:
    """Return what a participant has not done in time, and what to check."""
    waiting = participant.waiting
    if participant.phase == Phase.READY:
        return "is ready, and does not answer those that connect to it", "does it hang?"
    if phase == "spawn" and participant.external is not None:
        ticket = participant.external.ticket.path
        return "is not there", f"has anybody started it with `stepbus join {ticket}`?"
    if phase == "spawn":
        return "has not reached the bus", "does its program take part with stepbus?"
    if phase == "join":
        return "has reached the bus and not asked to join", "does it hang?"
    if waiting is not None:
        sources = ", ".join(waiting.sources)
        return f"is not connected to {sources}, which is up", "can the two reach each other?"
    return f"has joined and {_worker(participant)}is not ready", _why_not_ready(participant)


def refused(participant: ParticipantState, reason: str) -> StartFailed:
    """Return the failure of a participant that was not admitted (P4.3)."""
    return StartFailed(
        f"before the first step: {participant.who()} was refused: {reason}",
        participant=participant.name,
    )


def late_for_step(late: list[ParticipantState], barrier: Barrier, step_ns: int) -> StepTimeout:
    """Return the failure of the participants that hold a step past their deadline."""
    step = _stuck_at(late[0])
    sentences = [_holds(participant, barrier) for participant in late]
    return StepTimeout(
        f"{at(step, step_ns)}: {'; '.join(sentences)}", participant=late[0].name, step=step
    )


def late_to_close(participant: ParticipantState, end: int, step_ns: int) -> StepTimeout:
    """Return the failure of a participant whose closing outputs do not come (P11.3)."""
    return StepTimeout(
        f"{at(end, step_ns)}: {participant.who()} has not published its closing outputs for "
        f"{participant.holds_s:.1f} s; {deadline(participant.spec, 'stop')}",
        participant=participant.name,
        step=end,
    )


def missing_bulk(end: int, waited_s: float, deadline_s: float, step_ns: int) -> StepTimeout:
    """Return the failure of a run whose announced bulk content does not come (P7.5)."""
    return StepTimeout(
        f"{at(end, step_ns)}: announced bulk content has not arrived for {waited_s:.1f} s; "
        f"deadline {deadline_s:g} s (stop_timeout); was it published?",
        step=end,
    )


def took_nothing(
    participant: ParticipantState, participants: Participants, barrier: Barrier, step_ns: int
) -> StepTimeout:
    """Return the failure of a participant that was killed because it read nothing any more."""
    step = owed_step(participant.name, participants, barrier)
    return StepTimeout(
        f"{at(step, step_ns)}: {participant.who()} has read nothing for "
        f"{seconds(participant.spec, 'step'):g} s, and messages to it piled up; "
        f"{deadline(participant.spec, 'step')}",
        participant=participant.name,
        step=step,
    )


def kept_thread(
    participant: ParticipantState,
    late: KeptThread,
    participants: Participants,
    barrier: Barrier,
    step_ns: int,
) -> RunFailure:
    """Return the failure of a participant that kept the thread it shares past its deadline."""
    is_ready = participant.phase == Phase.READY
    phase = "step" if is_ready else "ready"
    step = owed_step(participant.name, participants, barrier) if is_ready else -1
    held = f"has been computing for {late.held_s:.1f} s, at {late.where}"
    if not late.where:
        stopped = ", which has been stopped by a signal or a debugger" * late.is_stopped
        held = f"has waited {late.held_s:.1f} s for its program{stopped}"
    sentence = (
        f"{at(step, step_ns)}: {participant.who()} {held}; {deadline(participant.spec, phase)}; "
        f"{participant.where_it_prints()}"
    )
    if not is_ready:
        return StartFailed(sentence, participant=participant.name)
    return StepTimeout(sentence, participant=participant.name, step=step)


def death(
    participant: ParticipantState, participants: Participants, barrier: Barrier, step_ns: int
) -> RunFailure:
    """Return the failure of a participant whose process has ended (P10.4)."""
    is_ready = participant.phase == Phase.READY
    step = owed_step(participant.name, participants, barrier) if is_ready else -1
    sentence = (
        f"{at(step, step_ns)}: {participant.who()} {participant.process.how_it_ended()}"
        f"{_last_words(participant)}; {participant.where_it_prints()}"
    )
    if not is_ready:
        return StartFailed(sentence, participant=participant.name)
    return ParticipantDied(sentence, participant=participant.name, step=step)


def _last_words(participant: ParticipantState) -> str:
    problem = participant.process.log_problem()
    if problem:
        return f"; its log cannot be written ({problem}), so the reason may be missing there"
    output = participant.process.last_error()
    return f'; its last output: "{output}"' if output else ""


def skipped(
    participant: ParticipantState, step: int, barrier: Barrier, step_ns: int
) -> ParticipantFault:
    """Return the failure of a participant that left out a step (P7.1)."""
    expected = barrier.next_step(participant.name)
    return ParticipantFault(
        f"{at(expected, step_ns)}: {participant.who()} reported step {step} instead; "
        "it must publish at every step it fires at, in order",
        participant=participant.name,
        step=expected,
    )


def _stuck_at(participant: ParticipantState) -> int:
    """Return the step a participant does not complete.

    One that publishes first owes the outputs of the next step when it waits for inputs of this.
    """
    waiting = participant.waiting
    if waiting is not None and waiting.sources and _waits_in_held_step(participant):
        return waiting.step
    return participant.held_step


def _waits_in_held_step(participant: ParticipantState) -> bool:
    ahead = participant.spec.every if participant.spec.publishes == "first" else 0
    return (
        participant.waiting is not None
        and participant.waiting.step + ahead == participant.held_step
    )


def _holds(participant: ParticipantState, barrier: Barrier) -> str:
    """Return why a participant holds the step, as far as the orchestrator can see it."""
    limit = deadline(participant.spec, "step")
    held = f"{participant.holds_s:.1f} s"
    missing = barrier.missing(participant.name)
    waiting = participant.waiting
    if participant.process.activity().is_stopped:
        return (
            f"{participant.who()} has been stopped by a signal or a debugger, and has held the "
            f"step for {held}; {limit}"
        )
    if missing:
        return f"{participant.who()} still waits for {', '.join(missing)}; {limit}"
    if waiting is not None and waiting.sources and _waits_in_held_step(participant):
        return (
            f"{participant.who()} has been waiting for {', '.join(waiting.sources)} for {held}, "
            f"whose outputs were published; was a message lost or dropped? It reports "
            f"{_drops(participant)}; {limit}"
        )
    if waiting is not None and participant.missed_trigger:
        return (
            f"{participant.who()} has held the step for {held}: it reports that it waits for the "
            f"trigger of step {waiting.step}, which was sent, and {_drops(participant)}; does it "
            f"read `step_limit` (docs/protocol.md, P5.1)? {limit}"
        )
    if participant.spec.bridge is not None:
        return (
            f"{participant.who()} has been waiting for {_worker(participant)}for {held}; "
            f"inputs arrived; does it answer every message, and flush the answer? {limit}"
        )
    drops = f"; it reports {_drops(participant)}" if participant.drops else ""
    return f"{participant.who()} has been computing for {held}; inputs arrived{drops}; {limit}"


def _drops(participant: ParticipantState) -> str:
    """Return how many messages it has dropped: `3 dropped messages (2 stale, 1 duplicate)`."""
    causes = ", ".join(f"{count} {cause}" for cause, count in participant.drops.items())
    total = sum(participant.drops.values())
    return f"{total} dropped message{'s' * (total != 1)}" + (f" ({causes})" if causes else "")


def _why_not_ready(participant: ParticipantState) -> str:
    loading = "is its model still loading?"
    if participant.spec.bridge is None:
        return loading
    return f"{loading} Does it write its answers to descriptor 4, and flush them?"


def _worker(participant: ParticipantState) -> str:
    """Return the program behind a bridge, which does the participant's work."""
    return "" if participant.spec.bridge is None else f"`{' '.join(participant.spec.program)}` "
