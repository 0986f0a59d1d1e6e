"""Who is late, and the sentence that says so."""

from __future__ import annotations

from stepbus_orchestrator.errors import (
    ParticipantDied,
    ParticipantFault,
    RunFailure,
    StartFailed,
    StepTimeout,
)
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_schemas import due_step

from .barrier import Barrier
from .participants import PHASE_DEADLINES, Member, Phase, Roster


def seconds(spec: ParticipantSpec, phase: str) -> float:
    """Return one of a participant's deadlines [s]."""
    value: float = getattr(spec.deadlines, f"{phase}_s")
    return value


def at(step: int, step_ns: int) -> str:
    """Return `step 1042 (t = 5.210 s)`, or `before the first step`."""
    if step < 0:
        return "before the first step"
    return f"step {step} (t = {step * step_ns * 1e-9:.3f} s)"


def check_start(roster: Roster, elapsed_s: float) -> None:
    """Let the clock of all who are not ready run on; raises StartFailed for one who is late."""
    for member in roster.values():
        if member.phase == Phase.READY or _waits_for_others(member, roster):
            continue
        member.in_phase_s += elapsed_s
        phase = PHASE_DEADLINES[member.phase]
        deadline = seconds(member.spec, phase)
        if member.in_phase_s > deadline:
            raise StartFailed(_late_to_start(member, phase, deadline), participant=member.name)


def _waits_for_others(member: Member, roster: Roster) -> bool:
    """Return whether it waits for a handshake of somebody who is not that far yet."""
    if member.phase != Phase.JOINED or member.waiting is None:
        return False
    sources = [roster[name] for name in member.waiting.sources if name in roster]
    return any(source.phase < Phase.READY and source.waiting is None for source in sources)


def _late_to_start(member: Member, phase: str, deadline: float) -> str:
    what = {
        "spawn": "has not reached the bus; does its program take part with stepbus?",
        "join": "has reached the bus and not asked to join; does it hang?",
        "ready": f"has joined and {_worker(member)}is not ready; {_why_not_ready(member)}",
    }[phase]
    if phase == "ready" and member.waiting is not None:
        sources = ", ".join(member.waiting.sources)
        what = f"has not heard {sources}, which is up; can the two reach each other on the bus?"
    return (
        f"before the first step: {member.who()} {what} Deadline {deadline:g} s "
        f"(participants.{member.name}.{phase}_timeout); its log: {member.child.log}"
    )


def owed_step(name: str, roster: Roster, barrier: Barrier) -> int:
    """Return the step whose output a participant owes.

    Its own reports lag behind by up to a log batch; whoever waits for it knows better.
    """
    every = roster[name].spec.every
    newest = roster[name].newest()
    owed = max(barrier.next_step(name), newest + every if newest >= 0 else 0)
    for member in roster.values():
        if member.waiting is not None and name in member.waiting.sources:
            delays = [i.delay for i in member.spec.inputs.values() if i.source == name]
            owed = max(owed, due_step(member.waiting.step, min(delays), every))
    return owed


def check_step(roster: Roster, barrier: Barrier, elapsed_s: float, step_ns: int) -> None:
    """Let the clock of those who hold the step run on; raises StepTimeout for one who is late."""
    holders = barrier.holders() or [
        name for name in roster if barrier.next_step(name) <= barrier.completed
    ]
    for name in holders:
        roster[name].hold(owed_step(name, roster, barrier), elapsed_s)
    late = [m for m in map(roster.__getitem__, holders) if m.holds_s > seconds(m.spec, "step")]
    # Whoever sends to a process that is stopped may be held up by it.
    late = [member for member in late if member.child.is_stopped()] or late
    if late:
        step = _stuck_at(late[0])
        sentences = [_holds(member, barrier) for member in late]
        raise StepTimeout(
            f"{at(step, step_ns)}: {'; '.join(sentences)}", participant=late[0].name, step=step
        )


def _stuck_at(member: Member) -> int:
    """Return the step a participant does not get done.

    One that publishes first owes the outputs of the next step when it waits for inputs of this.
    """
    waiting = member.waiting
    if waiting is not None and waiting.sources and _waits_in_held_step(member):
        return waiting.step
    return member.held_step


def _waits_in_held_step(member: Member) -> bool:
    ahead = member.spec.every if member.spec.publishes == "first" else 0
    return member.waiting is not None and member.waiting.step + ahead == member.held_step


def _holds(member: Member, barrier: Barrier) -> str:
    deadline = seconds(member.spec, "step")
    limit = f"deadline {deadline:g} s (participants.{member.name}.step_timeout)"
    missing = barrier.missing(member.name)
    waiting = member.waiting
    if member.child.is_stopped():
        return (
            f"{member.who()} has been stopped by a signal or a debugger, and has held the step for "
            f"{member.holds_s:.1f} s; {limit}"
        )
    if missing:
        return f"{member.who()} still waits for {', '.join(missing)}; {limit}"
    if waiting is not None and waiting.sources and _waits_in_held_step(member):
        dropped = sum(member.drops.values())
        return (
            f"{member.who()} has been waiting for {', '.join(waiting.sources)} for "
            f"{member.holds_s:.1f} s, whose outputs were published; was a message lost or "
            f"dropped ({dropped} dropped so far)? {limit}"
        )
    if member.spec.bridge is not None:
        return (
            f"{member.who()} has been waiting for {_worker(member)}for {member.holds_s:.1f} s; "
            f"inputs arrived; does it answer every message? {limit}"
        )
    return f"{member.who()} has been computing for {member.holds_s:.1f} s; inputs arrived; {limit}"


def _why_not_ready(member: Member) -> str:
    loading = "is its model still loading?"
    if member.spec.bridge is None:
        return loading
    return f"{loading} Does it write its answers to descriptor 4, and flush them?"


def _worker(member: Member) -> str:
    """Return who does a participant's work, where it is not the participant itself."""
    return "" if member.spec.bridge is None else f"`{' '.join(member.spec.exec)}` "


def took_nothing(member: Member, roster: Roster, barrier: Barrier, step_ns: int) -> StepTimeout:
    """Return the failure of a participant that was killed because it read nothing any more."""
    step = owed_step(member.name, roster, barrier)
    deadline = seconds(member.spec, "step")
    return StepTimeout(
        f"{at(step, step_ns)}: {member.who()} has taken in nothing for {deadline:g} s, and "
        f"messages to it piled up; deadline {deadline:g} s "
        f"(participants.{member.name}.step_timeout)",
        participant=member.name,
        step=step,
    )


def death(member: Member, roster: Roster, barrier: Barrier, step_ns: int) -> RunFailure:
    """Return the failure of a participant whose process has ended."""
    step = owed_step(member.name, roster, barrier) if member.phase == Phase.READY else -1
    said = member.child.last_error()
    tail = f'; it last said: "{said}"' if said else ""
    sentence = (
        f"{at(step, step_ns)}: {member.who()} {member.child.how_it_ended()}{tail}; "
        f"its log: {member.child.log}"
    )
    if member.phase < Phase.READY:
        return StartFailed(sentence, participant=member.name)
    return ParticipantDied(sentence, participant=member.name, step=step)


def skipped(member: Member, step: int, barrier: Barrier, step_ns: int) -> ParticipantFault:
    """Return the failure of a participant that left out a step."""
    expected = barrier.next_step(member.name)
    return ParticipantFault(
        f"{at(expected, step_ns)}: {member.who()} reported step {step} instead; "
        "it must publish at every step it fires at, in order",
        participant=member.name,
        step=expected,
    )
