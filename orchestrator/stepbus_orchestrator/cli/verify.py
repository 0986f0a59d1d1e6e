"""`stepbus verify`: the same result under different conditions, or the first step that differs."""

from collections.abc import Mapping
from pathlib import Path

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.verify import TrialResult, Verification, verify
from stepbus_orchestrator.cli.commands import Verify
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.processes import can_host
from stepbus_orchestrator.processes.warm import warm_parent
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import partly_recorded

_SHOWN_HASH = 12


def verify_command(given: Verify) -> Answer:
    """Run the scenario under each condition, and return whether all recordings are equal."""
    loaded = load(given.scenario, given.set)
    with (
        displayed(f"verify {loaded.name}", quiet=given.json) as display,
        interruptible() as interrupt,
        warm_parent(
            [spec.participant for spec in loaded.participants], runs=given.runs + can_host()
        ),
    ):
        verification = verify(
            loaded,
            runs=given.runs,
            seed=given.seed,
            out=given.out,
            on_result=lambda trial, count: display and display.say(_line(trial, count)),
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
