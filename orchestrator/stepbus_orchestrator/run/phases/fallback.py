"""Fallback: the run continues without a participant that has failed, to a safe stop."""

import signal

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.fallback.rest import motion_at_end
from stepbus_orchestrator.run.kernel.phase import RunPhase
from stepbus_orchestrator.run.loop.loop import LAST_REPORTS_S, LONGEST_TICK_S, RunLoop

from .stepping import step


def fall_back(loop: RunLoop, failure: RunFailure) -> RunPhase:
    """Replace the participant that failed for as long as the scenario says (`on_fault`)."""
    state = loop.state
    participant = state.participants[failure.participant or ""]
    participant.process.signal(signal.SIGKILL)
    participant.process.wait(LONGEST_TICK_S)
    state.replaced = participant.name
    loop.receive_for(LAST_REPORTS_S)
    first, until = loop.safe_stop.start(participant.name, loop.descriptions)
    state.end = (until, f"{participant.name} has failed; the run was held")
    loop.recorder.add_metadata(
        layout.FALLBACK_METADATA,
        {"participant": participant.name, "first": str(first), "until": str(until)},
    )
    loop.timing.event("hold", participant.name, f"steps {first} to {until - 1}")
    loop.observer.event("error", participant.name, first, f"{failure}; holding until step {until}")
    return step(loop)


def after_fallback(failure: RunFailure, loop: RunLoop) -> RunFailure:
    """Return the failure of a run that has come to its safe stop."""
    first, until = loop.safe_stop.replaced_steps
    state = loop.state
    rests = motion_at_end(state.scenario, loop.descriptions, state.newest)
    text = f"its commands were held from step {first} to {until} {rests}"
    return _extended(failure, text, failure)


def failed_in_fallback(failure: RunFailure, other: RunFailure) -> RunFailure:
    """Return the failure of a run in whose fallback something else failed."""
    return _extended(failure, f"while its commands were held: {other}", other)


def _extended(failure: RunFailure, text: str, cause: RunFailure) -> RunFailure:
    extended = type(failure)(
        f"{failure}; {text}", participant=failure.participant, step=failure.step
    )
    extended.__cause__ = cause
    return extended
