"""`stepbus diff`, `replay` and `verify`: recordings, a participant and its recording, runs."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.tolerance import Tolerance, parse_tolerance, read_tolerance
from stepbus_orchestrator.analysis.verify import TrialResult, Verification, verify
from stepbus_orchestrator.cli.commands import Diff, Replay, Tolerances, Verify
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.repeat import check_trust
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.processes import can_host
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_orchestrator.replay.trust import find_source
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import partly_recorded
from stepbus_schemas import WiringError

_SHOWN_HASH = 12


def diff_command(given: Diff) -> Answer:
    """Return how two recordings differ."""
    difference = diff(given.first, given.second, tolerance_of(given.tolerances), code=given.code)
    code = ExitCode.FINISHED if difference.equal else ExitCode.DIFFERENT
    return Answer(value=difference, lines=[difference.text()], code=code)


def tolerance_of(given: Tolerances, participant: str = "") -> Tolerance:
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
    tolerance = tolerance_of(given.tolerances, participant)
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
        lines=replayed(result),
        code=ExitCode.FINISHED if result.equal else ExitCode.DIFFERENT,
    )


def replayed(result: ReplayResult) -> Iterator[str]:
    """Yield the lines of a replay."""
    yield result.text()
    yield f"wall time {result.wall_s:.2f} s ({result.steps_per_s:.0f} steps/s)"
    if result.updated is not None:
        replaced = sum(port.within + port.different for port in result.ports)
        yield f"wrote {result.updated}: replaced {replaced} messages of {result.participant}"


def verify_command(given: Verify) -> Answer:
    """Run the scenario under each condition, and return whether all recordings are equal."""
    loaded = load(given.scenario, given.set)

    def show(result: TrialResult, count: int) -> None:
        if display is not None:
            display.say(_line(result, count))

    with (
        displayed(f"verify {loaded.name}", quiet=given.json) as display,
        interruptible() as interrupt,
    ):
        verification = verify(
            loaded,
            runs=given.runs,
            seed=given.seed,
            out=given.out,
            on_result=show,
            observer=display,
            interrupt=interrupt,
            owns_descriptors=can_host(),
        )
    return _answer(verification, given.out, partly_recorded(loaded.participants))


def _answer(
    verification: Verification, out: Path | None, partly: Mapping[str, Mapping[str, int]]
) -> Answer:
    first, code = verification.results[0].result, ExitCode.FINISHED
    difference, error = None, ""
    lines = [
        f"{len(verification.results)} runs of {first.steps} steps, all identical",
        first.hashes(),
    ]
    if verification.failed:
        failed = verification.failed.result
        error, lines, code = failed.reason, [], ExitCode(failed.exit_code)
    elif verification.different:
        one, other = verification.different
        difference = diff(one.result.recording, other.result.recording)
        error = (
            f"run {other.trial.number} differs from run {one.trial.number}: the same "
            "scenario gave different results"
        )
        lines, code = [difference.text()], ExitCode.DIFFERENT
    if partly:
        names = [f"{name}.{port}" for name, ports in partly.items() for port in ports]
        lines.append(f"compared only where recorded: {', '.join(names)}")
    if out or code:
        lines.append(f"runs kept in {verification.folder}")
    value = {"equal": not code, "diff": difference, "runs": verification.results}
    return Answer(value=value, lines=lines, error=error, code=code)


def _line(result: TrialResult, count: int) -> str:
    trial = result.trial
    what = result.result.sha256[:_SHOWN_HASH] or "no recording"
    circumstances = (
        "all participants in one process"
        if trial.in_process
        else f"{trial.transport:4}, started {' '.join(trial.start_order)}, {result.delays:4} delays"
    )
    return (
        f"run {trial.number} of {count}: window {trial.window:2}, {circumstances}: {what}, "
        f"{result.steps_per_s:.0f} steps/s"
    )
