"""The phases of a run: start-up, stepping, closing, shutdown, and the fallback (P4, P5, P11)."""

import signal

from stepbus_orchestrator.errors import (
    ParticipantDied,
    RunFailure,
    StopTimeout,
)
from stepbus_orchestrator.processes.child import TERM_GRACE_S
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.kernel.admission import batches_of
from stepbus_orchestrator.run.kernel.descriptions import check_descriptions, input_descriptions
from stepbus_orchestrator.run.kernel.state import RunPhase
from stepbus_orchestrator.run.safe_messages import motion_at_end
from stepbus_orchestrator.scenario.model import Deadlines
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_schemas import Start, encode, reached

from .kernel.deadlines import check_bulk, check_closing, check_start, check_step
from .kernel.participants import ParticipantState, Phase
from .run import LONGEST_TICK_S, SHORT_TICK_S, Run

_LAST_S = 0.5
"""How long the last messages of a process may come behind its end [s]."""
OWN_WORK_S = 60.0
"""How long a program that has left a complete run may work on, to save a plot for example [s]."""
_LEAVE_S = 1.0
"""How long a run that has failed waits for a process that the user has started [s]."""


def run_phases(run: Run) -> str:
    """Go through the phases of a run and return why it ended.

    Every process is ended, whatever happens. Raises RunFailure when the run ends before its time,
    or a participant does not end as it should.
    """
    failure: RunFailure | None = None
    try:
        failure = _until_shutdown(run)
    except BaseException:
        run.stop("the orchestrator ends")
        raise
    finally:
        run.state.enter(RunPhase.SHUTDOWN)
        late = _shut_down(run, failure)
    if failure is not None:
        raise failure
    _check_ends(run, late)
    return run.state.reason


def _until_shutdown(run: Run) -> RunFailure | None:
    """Go through the phases before the shutdown; return what ends the run before its time."""
    failure: RunFailure | None = None
    try:
        _start_up(run)
        run.state.enter(RunPhase.STEPPING)
        try:
            _step(run)
        except RunFailure as exc:
            # Behind what cannot be recorded, safe messages would leave a hole.
            if run.recorder.has_broken(exc.participant) or not run.safe_stop.can_handle(exc):
                raise
            failure = exc
            run.state.enter(RunPhase.FALLBACK)
            _fall_back(run, exc)
        run.state.enter(RunPhase.CLOSING)
        _close(run)
        if failure is not None:
            failure = _after_fallback(failure, run)
    except RunFailure as exc:
        if failure is not None:
            reached("something fails while a participant is replaced")
            failure = _extended(failure, f"while its commands were held: {exc}", exc)
        failure = failure or exc
    if failure is not None:
        run.stop(str(failure))
    return failure


# --- start-up -----------------------------------------------------------------------------


def _start_up(run: Run) -> None:
    """Start every participant, wait until all are ready, and publish the `Start`."""
    state = run.state
    run.strategy.launch(run)
    while not state.is_ready:
        for extension in run.extensions:
            extension.awaiting(state.participants.values())
        run.turn(lambda elapsed_s: check_start(state, elapsed_s))
    ready = {name: one.ready for name, one in state.participants.items() if one.ready is not None}
    run.descriptions = {
        **run.descriptions,
        **{name: dict(item.outputs) for name, item in ready.items()},
    }
    inputs = input_descriptions(state.scenario, run.descriptions)
    check_descriptions(state.participants, inputs)
    versions = {name: dict(item.versions) for name, item in ready.items()}
    run.recorder.open_channels(run.descriptions, versions)
    batches = {} if state.is_repeating else batches_of(state.scenario, state.participants)
    slots = run.strategy.slots.agree(ready)
    if run.strategy.has_links:
        state.check_bulk(slots)
    message = encode(Start(token=run.session.token, inputs=inputs, batches=batches, slots=slots))
    state.check_size("the descriptions of all inputs", message)
    for extension in run.extensions:
        extension.ready()
    run.timing.event("start")
    state.started_at = run.clock.monotonic()
    run.announcer.start(message)


# --- stepping and closing ------------------------------------------------------------------


def _step(run: Run) -> None:
    """Release step after step until the last one is complete."""
    state = run.state
    barrier = state.barrier
    run.release(always=True)
    while not state.is_complete:
        before = barrier.count
        run.turn(lambda elapsed_s: _check(run, elapsed_s))
        if barrier.count == before:
            # A participant may have missed it: it was published before the link was complete.
            run.announcer.repeat(with_start=not barrier.has_all_started)


def _check(run: Run, elapsed_s: float) -> None:
    run.release(always=True)
    # No participant is late while a gate holds the run.
    if not run.state.is_held:
        check_step(run.state, elapsed_s)
        run.repeats.look(run.state.barrier.holders(), "step", run.observer)


def _close(run: Run) -> None:
    """Ask for the closing outputs (P11.3), and finish the recording behind them."""
    state = run.state
    end = state.last_step
    schedule = Schedule(state.scenario)
    closing = [name for name in schedule.order if schedule.closing(name, end)]
    run.stop(state.reason, at_step=end)
    _await_outputs(run, closing)
    _await_bulk(run)
    run.is_recorded = True
    run.recorder.finish(end, closing)


def _await_outputs(run: Run, closing: list[str]) -> None:
    state = run.state
    while any(state.barrier.reported[name] < state.last_step for name in closing):
        run.turn(lambda elapsed_s: _check_closing(run, closing, elapsed_s))


def _check_closing(run: Run, closing: list[str], elapsed_s: float) -> None:
    check_closing(run.state, closing, elapsed_s)
    owing = [name for name in closing if run.state.barrier.reported[name] < run.state.last_step]
    run.repeats.look(owing, "stop", run.observer)


def _await_bulk(run: Run) -> None:
    began = run.clock.monotonic()
    while run.recorder.owing_bulk():
        run.turn(
            lambda _elapsed_s: check_bulk(
                run.state, run.recorder.owing_bulk(), run.clock.monotonic() - began
            )
        )


# --- fallback -----------------------------------------------------------------------------


def _fall_back(run: Run, failure: RunFailure) -> None:
    """Replace the participant that failed for as long as the scenario says (`on_fault`)."""
    state = run.state
    participant = state.participants[failure.participant or ""]
    reached("a participant is replaced")
    participant.process.signal(signal.SIGKILL)
    participant.process.wait(LONGEST_TICK_S)
    state.replaced = participant.name
    run.receive_last_reports(participant.name)
    first, until = run.safe_stop.start(participant.name, run.descriptions)
    state.end = (until, f"{participant.name} has failed; its commands were held")
    run.recorder.add_metadata(
        layout.FALLBACK_METADATA,
        {"participant": participant.name, "first": str(first), "until": str(until)},
    )
    run.timing.event("hold", participant.name, f"steps {first} to {until - 1}")
    run.observer.event("error", participant.name, first, f"{failure}; holding until step {until}")
    _step(run)


def _after_fallback(failure: RunFailure, run: Run) -> RunFailure:
    """Return the failure of a run that has come to its safe stop."""
    reached("a run comes to its safe stop")
    first, until = run.safe_stop.replaced_steps
    state = run.state
    rests = motion_at_end(state.scenario, run.descriptions, state.newest)
    text = f"its commands were held from step {first} to {until} {rests}"
    return _extended(failure, text, failure)


def _extended(failure: RunFailure, text: str, cause: RunFailure) -> RunFailure:
    extended = type(failure)(
        f"{failure}; {text}", participant=failure.participant, step=failure.step
    )
    extended.__cause__ = cause
    return extended


# --- shutdown -----------------------------------------------------------------------------


def _shut_down(run: Run, failure: RunFailure | None) -> list[ParticipantState]:
    """End every process, take what is still reported, and return those that were late.

    Each has its stop deadline. The run does not wait for the culprit, nor for a participant that is
    not ready: it has nothing to save.
    """
    participants = run.state.participants
    culprit = participants.get(failure.participant or "") if failure is not None else None
    if culprit is not None and culprit.external is None:
        # Before the others: a process that reads nothing blocks those that publish to it.
        culprit.process.end()
    waits_for = [
        one
        for one in participants.values()
        if one.phase == Phase.READY
        and (one is not culprit or one.external is not None)
        # In a run that has failed, one that is stopped as well would only be waited for.
        and not (failure is not None and one.process.activity().is_stopped)
    ]
    late = _await_ends(run, waits_for, has_failed=failure is not None)
    for one in late:
        one.works_on = one.is_on_its_own and failure is None
    for one in participants.values():
        one.process.terminate()
    # They share the grace between the two signals.
    give_up = run.clock.monotonic() + TERM_GRACE_S
    for one in participants.values():
        one.process.end(max(0.0, give_up - run.clock.monotonic()))
    # What they published before they ended may arrive after their exit codes.
    give_up = run.clock.monotonic() + _LAST_S
    run.receive_after_failure(0.0)
    while run.clock.monotonic() < give_up and not all(
        one.has_left or one.external is not None for one in waits_for
    ):
        run.receive_after_failure(SHORT_TICK_S)
    run.announcer.close()
    return [one for one in late if not one.works_on]


def _await_ends(
    run: Run, participants: list[ParticipantState], *, has_failed: bool
) -> list[ParticipantState]:
    began = run.clock.monotonic()
    while True:
        left = [one for one in participants if one.process.exit_code() is None]
        waited_s = run.clock.monotonic() - began
        if not any(waited_s < _patience_s(run, one, has_failed=has_failed) for one in left):
            return left
        for extension in run.extensions:
            extension.awaiting(left)
        run.announcer.repeat_stop()
        run.receive_after_failure(SHORT_TICK_S)


def _patience_s(run: Run, participant: ParticipantState, *, has_failed: bool) -> float:
    """Return how long a participant may take to end [s]; not long after Ctrl-C."""
    if has_failed and participant.external is not None:
        # It may stand in a debugger, and is not ours to end.
        return _LEAVE_S
    stop_s = participant.limit_s("stop")
    if run.interrupt.is_set():
        return min(stop_s, Deadlines.stop_s)
    return max(stop_s, OWN_WORK_S) if participant.is_on_its_own and not has_failed else stop_s


def _check_ends(run: Run, late: list[ParticipantState]) -> None:
    """Raise for a participant that did not end in time, or with another exit code than 0."""
    participants = [one for one in run.state.participants.values() if not one.works_on]
    late += [one for one in participants if one.process.late is not None or one.name in run.killed]
    if late:
        reached("a participant is late to end")
        first = late[0]
        raise StopTimeout(
            (
                f"{', '.join(one.who() for one in late)} did not end within "
                f"{first.limit_s('stop'):g} s of the stop and was "
                f"{'killed' if first.external is None else 'left running'} "
                f"(participants.{first.name}.stop_timeout); the recording is complete"
            ),
            participant=first.name,
            step=run.state.steps,
        )
    for one in participants:
        if one.process.exit_code() != 0:
            reached("a participant ends with an error after the last step")
            raise ParticipantDied(
                f"after the last step: {one.who()} {one.process.how_it_ended()} while "
                f"stopping; the recording is complete; {one.where_it_prints()}",
                participant=one.name,
                step=run.state.steps,
            )
