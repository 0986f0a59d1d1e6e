"""The phases of a run: start-up, stepping, closing, shutdown, and the fallback (P4, P5, P11)."""

import signal

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.kernel.state import RunPhase
from stepbus_orchestrator.run.safe_messages import motion_at_end
from stepbus_orchestrator.scenario.schedule import Schedule

from .kernel.deadlines import check_bulk, check_closing, check_step
from .liveness import LAST_REPORTS_S
from .run import LONGEST_TICK_S, Run
from .shutdown import check_ends, shut_down
from .start_up import start_up


def run_phases(run: Run) -> str:
    """Go through the phases of a run and return why it ended.

    Every process is ended, whatever happens. Raises RunFailure when the run ends before its time,
    or a participant does not end as it should.
    """
    return _Machine(run).go()


class _Machine:
    """The phases in their order; which may follow which is in `kernel.phase`.

    failure: what ends the run before its time.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._failure: RunFailure | None = None

    def go(self) -> str:
        run = self._run
        try:
            self._until_shutdown()
        except BaseException:
            run.stop("the orchestrator ends")
            raise
        finally:
            run.state.enter(RunPhase.SHUTDOWN)
            late = shut_down(run, self._failure)
        if self._failure is not None:
            raise self._failure
        check_ends(run, late)
        return run.state.reason

    def _until_shutdown(self) -> None:
        phase = self._phase_after(RunPhase.START_UP)
        while phase is not RunPhase.SHUTDOWN:
            self._run.state.enter(phase)
            phase = self._phase_after(phase)
        if self._failure is not None:
            self._run.stop(str(self._failure))

    def _phase_after(self, phase: RunPhase) -> RunPhase:
        """Run one phase and return the one after it."""
        try:
            following = self._act(phase)
        except RunFailure as failure:
            return self._after(failure)
        if phase is RunPhase.CLOSING and self._failure is not None:
            self._failure = _after_fallback(self._failure, self._run)
        return following

    def _act(self, phase: RunPhase) -> RunPhase:
        if self._failure is not None and phase is RunPhase.FALLBACK:
            return _fall_back(self._run, self._failure)
        return _ACTS[phase](self._run)

    def _after(self, failure: RunFailure) -> RunPhase:
        """Return the phase that follows a failure."""
        if self._run.safe_stop.can_handle(failure):
            self._failure = failure
            return RunPhase.FALLBACK
        if self._failure is not None:
            failure = _failed_in_fallback(self._failure, failure)
        self._failure = failure
        return RunPhase.SHUTDOWN


def _step(run: Run) -> RunPhase:
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
    return RunPhase.CLOSING


def _check(run: Run, elapsed_s: float) -> None:
    run.release(always=True)
    # Nobody is late while a gate holds the run.
    if not run.state.is_held:
        check_step(run.state, elapsed_s)


def _close(run: Run) -> RunPhase:
    """Ask for the closing outputs (P11.3), and finish the recording behind them."""
    state = run.state
    end = state.last_step
    schedule = Schedule.of(state.scenario)
    closing = [name for name in schedule.order if schedule.closing(name, end)]
    run.stop(state.reason, at_step=end)
    _await_outputs(run, closing)
    _await_bulk(run)
    run.is_recorded = True
    run.recorder.finish(end, closing)
    return RunPhase.SHUTDOWN


def _await_outputs(run: Run, closing: list[str]) -> None:
    state = run.state
    while any(state.barrier.reported[name] < state.last_step for name in closing):
        run.turn(lambda elapsed_s: check_closing(state, closing, elapsed_s))


def _await_bulk(run: Run) -> None:
    began = run.clock.monotonic()
    while not run.recorder.bulk_complete():
        run.turn(lambda _elapsed_s: check_bulk(run.state, run.clock.monotonic() - began))


def _fall_back(run: Run, failure: RunFailure) -> RunPhase:
    """Replace the participant that failed for as long as the scenario says (`on_fault`)."""
    state = run.state
    participant = state.participants[failure.participant or ""]
    participant.process.signal(signal.SIGKILL)
    participant.process.wait(LONGEST_TICK_S)
    state.replaced = participant.name
    run.receive_for(LAST_REPORTS_S)
    first, until = run.safe_stop.start(participant.name, run.descriptions)
    state.end = (until, f"{participant.name} has failed; the run was held")
    run.recorder.add_metadata(
        layout.FALLBACK_METADATA,
        {"participant": participant.name, "first": str(first), "until": str(until)},
    )
    run.timing.event("hold", participant.name, f"steps {first} to {until - 1}")
    run.observer.event("error", participant.name, first, f"{failure}; holding until step {until}")
    return _step(run)


def _after_fallback(failure: RunFailure, run: Run) -> RunFailure:
    """Return the failure of a run that has come to its safe stop."""
    first, until = run.safe_stop.replaced_steps
    state = run.state
    rests = motion_at_end(state.scenario, run.descriptions, state.newest)
    text = f"its commands were held from step {first} to {until} {rests}"
    return _extended(failure, text, failure)


def _failed_in_fallback(failure: RunFailure, other: RunFailure) -> RunFailure:
    """Return the failure of a run in whose fallback something else failed."""
    return _extended(failure, f"while its commands were held: {other}", other)


def _extended(failure: RunFailure, text: str, cause: RunFailure) -> RunFailure:
    extended = type(failure)(
        f"{failure}; {text}", participant=failure.participant, step=failure.step
    )
    extended.__cause__ = cause
    return extended


_ACTS = {RunPhase.START_UP: start_up, RunPhase.STEPPING: _step, RunPhase.CLOSING: _close}
