"""Start-up: participants are started, admitted and ready; then the clock starts (P4)."""

import time
from pathlib import Path

from stepbus_orchestrator.errors import BusFailed, ParticipantFault, StartFailed
from stepbus_orchestrator.processes.links.endpoints import gone
from stepbus_orchestrator.run.kernel.admission import batches_of
from stepbus_orchestrator.run.kernel.deadlines import check_start
from stepbus_orchestrator.run.kernel.descriptions import check_descriptions, input_descriptions
from stepbus_orchestrator.run.kernel.participants import Phase
from stepbus_orchestrator.run.kernel.phase import RunPhase
from stepbus_orchestrator.run.loop.loop import RunLoop
from stepbus_schemas import Start, encode

_LEAVING_S = 3.0
_CHECK_S = 0.05


def start_up(loop: RunLoop) -> RunPhase:
    """Start every participant, wait until all are ready, and publish the `Start`.

    Raises BusFailed, and blames nobody, where somebody removed what the start needs.
    """
    try:
        return _start(loop)
    except (StartFailed, ParticipantFault) as exc:
        lost = _lost(loop, exc.participant)
        if lost is None:
            raise
        raise BusFailed(f"{gone(lost)} ({exc})") from exc


def _lost(loop: RunLoop, blamed: str | None) -> Path | None:
    """Return what somebody removed of what the start needs; None: nothing.

    Whoever ends, since it was refused, takes its socket away a moment before.
    """
    participants = loop.state.participants
    end_s = time.monotonic() + _LEAVING_S
    while True:
        alive = [
            name
            for name, participant in participants.items()
            if participant.phase > Phase.SPAWNED and participant.process.exit_code() is None
        ]
        lost = loop.strategy.lost(blamed if blamed in participants else None, alive)
        if lost is None or time.monotonic() > end_s:
            return lost
        time.sleep(_CHECK_S)


def _start(loop: RunLoop) -> RunPhase:
    state = loop.state
    loop.strategy.launch(state)
    while not state.is_ready:
        loop.strategy.peers.send_handshake()
        if loop.controls.invitations is not None:
            loop.controls.invitations.remind(state.participants.values())
        loop.turn(lambda elapsed_s: check_start(state.participants, elapsed_s))
    loop.descriptions = loop.strategy.descriptions(state.participants)
    inputs = input_descriptions(state.scenario, loop.descriptions)
    check_descriptions(state.participants, inputs)
    _open_channels(loop)
    is_live = not loop.strategy.peers.names and not state.is_prefix
    batches = batches_of(state.scenario, state.participants) if is_live else {}
    message = encode(Start(token=loop.session.token, inputs=inputs, batches=batches))
    state.check_size("the descriptions of all inputs", message)
    if loop.controls.injector is not None:
        loop.controls.injector.check(state.participants)
    loop.timing.event("start")
    state.started_at = time.monotonic()
    loop.announcer.start(message)
    return RunPhase.STEPPING


def _open_channels(loop: RunLoop) -> None:
    ready = {name: participant.ready for name, participant in loop.state.participants.items()}
    loop.recorder.open_channels(
        {name: dict(item.outputs) for name, item in ready.items() if item is not None},
        {name: dict(item.versions) for name, item in ready.items() if item is not None},
    )
