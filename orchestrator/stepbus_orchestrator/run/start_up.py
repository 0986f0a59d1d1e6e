"""Start-up: participants are started, admitted and ready; then the clock starts (P4)."""

from stepbus_orchestrator.errors import BusFailed, ParticipantFault, RunFailure, StartFailed
from stepbus_orchestrator.processes.endpoints import Mesh, gone, tcp_ports
from stepbus_orchestrator.run.kernel.admission import batches_of
from stepbus_orchestrator.run.kernel.deadlines import check_start
from stepbus_orchestrator.run.kernel.descriptions import check_descriptions, input_descriptions
from stepbus_orchestrator.run.kernel.participants import Phase
from stepbus_orchestrator.run.kernel.state import RunPhase
from stepbus_orchestrator.run.run import Run
from stepbus_schemas import Start, encode

_LEAVING_S = 3.0
_CHECK_S = 0.05
_USE_UNIX = "use `--transport unix`, whose sockets other users cannot reach"


def start_up(run: Run) -> RunPhase:
    """Start every participant, wait until all are ready, and publish the `Start`.

    Raises BusFailed, and blames nobody, where somebody removed what the start needs, or uses the
    TCP ports of the run.
    """
    try:
        return _start(run)
    except (StartFailed, ParticipantFault) as exc:
        why = "" if run.strategy.mesh is None else _obstacle(run, run.strategy.mesh, exc)
        if not why:
            raise
        raise BusFailed(f"{why} ({exc})") from exc


def _obstacle(run: Run, mesh: Mesh, failure: RunFailure) -> str:
    """Return what kept the participants from starting that is no fault of theirs; empty: nothing.

    Whoever ends, since it was refused, takes its socket away a moment before.
    """
    participants = run.state.participants
    blamed = failure.participant if failure.participant in participants else None
    end_s = run.clock.monotonic() + _LEAVING_S
    while True:
        ended = [name for name, one in participants.items() if one.process.exit_code() is not None]
        alive = [
            name
            for name, participant in participants.items()
            if participant.phase > Phase.SPAWNED and name not in ended
        ]
        lost = mesh.lost(blamed, alive)
        if lost is None or run.clock.monotonic() > end_s:
            break
        run.clock.sleep(_CHECK_S)
    if lost is not None:
        return gone(lost)
    left = [port for name in ended for port in tcp_ports(mesh.participants[name])]
    users = mesh.users.seen(left)
    return users and f"{users}, which keeps links from opening; {_USE_UNIX}"


def _start(run: Run) -> RunPhase:
    state = run.state
    run.strategy.launch(run)
    mesh = run.strategy.mesh
    while not state.is_ready:
        run.extensions.awaiting(state.participants.values())
        if mesh is not None:
            mesh.users.look()
        run.turn(lambda elapsed_s: check_start(state.participants, elapsed_s))
    if mesh is not None:
        _check_links(mesh)
    ready = {name: participant.ready for name, participant in state.participants.items()}
    run.descriptions = {
        **run.descriptions,
        **{name: dict(item.outputs) for name, item in ready.items() if item is not None},
    }
    inputs = input_descriptions(state.scenario, run.descriptions)
    check_descriptions(state.participants, inputs)
    versions = {name: dict(item.versions) for name, item in ready.items() if item is not None}
    run.recorder.open_channels(run.descriptions, versions)
    batches = {} if state.is_repeating else batches_of(state.scenario, state.participants)
    message = encode(Start(token=run.session.token, inputs=inputs, batches=batches))
    state.check_size("the descriptions of all inputs", message)
    run.extensions.ready()
    run.timing.event("start")
    state.started_at = run.clock.monotonic()
    run.announcer.start(message)
    return RunPhase.STEPPING


def _check_links(mesh: Mesh) -> None:
    """Raise BusFailed where a link leads through somebody else, who could cut it at any step.

    A relay cannot read or change what is encrypted. It had the port before its owner, and has a
    connection at it for as long as it passes on what comes.
    """
    users = mesh.users.look()
    if users:
        raise BusFailed(f"before the first step: {users}, and may stand in a link; {_USE_UNIX}")
