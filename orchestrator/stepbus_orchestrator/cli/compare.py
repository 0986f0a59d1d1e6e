"""`stepbus diff` and `replay`: two recordings, or one participant and its recording."""

from collections.abc import Iterator

import msgspec

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.tolerance import Tolerance, parse_tolerance, read_tolerance
from stepbus_orchestrator.cli.commands import Diff, Replay, Tolerances
from stepbus_orchestrator.cli.rerun import check_trust
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_orchestrator.replay.trust import find_source
from stepbus_schemas import WiringError


def diff_command(given: Diff) -> Answer:
    """Return how two recordings differ."""
    difference = diff(given.first, given.second, _tolerance(given.tolerances))
    code = ExitCode.FINISHED if difference.equal else ExitCode.DIFFERENT
    return Answer(value=difference, lines=[difference.text()], code=code)


def _tolerance(given: Tolerances, participant: str = "") -> Tolerance:
    """Return the tolerance; the command line takes precedence over the file."""
    from_file = Tolerance() if given.tolerance is None else read_tolerance(given.tolerance)
    return from_file | parse_tolerance(given.abs, given.rel, given.ignore, participant)


def replay_command(given: Replay) -> Answer:
    """Run one participant on its recorded inputs, and return how its outputs differ."""
    recording, participant, program = given.recording, given.participant, given.program
    if program == ():
        raise WiringError("--exec: no program given; write it last, with its arguments")
    if program and given.source:
        raise WiringError(
            "--source cannot be combined with --exec, whose program starts in the current folder"
        )
    is_copy = given.recorded or bool(program)
    source = None if is_copy else find_source(Recording(recording), given.source)
    tolerance = _tolerance(given.tolerances, participant)
    if source is None:
        check_trust(Recording(recording), participant, trust=given.trust, own_program=bool(program))
    with (
        displayed(f"replay of {participant}", quiet=given.json) as display,
        interruptible() as interrupt,
    ):
        result = replay(
            recording,
            participant,
            tolerance=tolerance,
            set=given.set,
            update=given.update,
            window=given.window,
            recorded=source is None,
            source=source,
            bridge=given.bridge,
            program=program,
            observer=display,
            interrupt=interrupt,
        )
    return Answer(
        value={**msgspec.structs.asdict(result), "steps_per_s": result.steps_per_s},
        lines=_replayed(result),
        code=ExitCode.FINISHED if result.equal else ExitCode.DIFFERENT,
    )


def _replayed(result: ReplayResult) -> Iterator[str]:
    yield result.text()
    yield f"wall time {result.wall_s:.2f} s ({result.steps_per_s:.0f} steps/s)"
    if result.updated is not None:
        replaced = sum(port.within + port.different for port in result.ports)
        yield f"wrote {result.updated}: replaced {replaced} messages of {result.participant}"
