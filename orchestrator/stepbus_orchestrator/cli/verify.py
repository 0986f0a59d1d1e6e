"""`stepbus verify`: the same result under different conditions, or the first step that differs."""

import contextlib
import dataclasses
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.verify import TrialResult, Verification, plan, verify
from stepbus_orchestrator.cli.output import Answer, say
from stepbus_orchestrator.cli.parameters import Json, ScenarioName, Set, command, number
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.processes.launcher import is_set
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import make_new_folder

_SHOWN_HASH = 12


@command(is_run=True)
def verify_command(
    scenario: ScenarioName,
    *,
    set: Set = (),
    n: Annotated[int, {"flag": "-n", "type": number("not a number of runs, at least 2", 2)}] = 5,
    seed: Annotated[int, {"type": number("not a seed, a number from 0 on", 0)}] = 0,
    keep: Annotated[Path | None, {"metavar": "FOLDER"}] = None,
    json: Json = False,
) -> Answer:
    """Run a scenario several times and compare the recordings.

    Runs a scenario several times: once as it is, then with shuffled start order, random delays in
    every participant, and other windows and transports, and last with all participants in one
    process, where they can share one. All recordings must be equal byte for byte. Exit code 10: two
    differ; the first difference is shown.

    n: number of runs in separate processes. seed: seed of the start orders and delays. keep: keep
    the runs in this new folder.

    $ stepbus verify two_link
    $ stepbus verify two_link -n 10 --set duration=2s --seed 1
    """
    loaded = load(scenario, set)
    trials = plan(loaded, n, seed, in_process=is_set())

    def show(trial: TrialResult) -> None:
        if not json:
            say(_line(trial, len(trials)))

    with _folder(keep) as folder, interruptible() as interrupt:
        verification = verify(
            loaded,
            trials,
            folder,
            seed=seed,
            on_result=show,
            interrupt=interrupt,
            owns_descriptors=is_set(),
        )
    answer = _answer(verification)
    if keep is None and not answer.code:
        shutil.rmtree(folder)
        return answer
    return dataclasses.replace(answer, lines=[*answer.lines, f"the runs are in {folder}"])


def _answer(verification: Verification) -> Answer:
    first, code = verification.results[0].result, ExitCode.FINISHED
    difference, error = None, ""
    lines = [f"{len(verification.results)} runs of {first.steps} steps, one result", first.hashes()]
    if verification.failed:
        failed = verification.failed.result
        error, lines, code = failed.reason, [], ExitCode(failed.exit_code)
    elif verification.different:
        one, other = verification.different
        difference = diff(one.result.recording, other.result.recording)
        error = (
            f"run {other.trial.number} differs from run {one.trial.number}: the same scenario "
            "gave two results"
        )
        lines, code = [difference.text()], ExitCode.DIFFERENT
    value = {"equal": not code, "diff": difference, "runs": verification.results}
    return Answer(value=value, lines=lines, error=error, code=code)


@contextlib.contextmanager
def _folder(keep: Path | None) -> Iterator[Path]:
    """Make the folder of the runs; remove it where the first one could not even begin.

    Raises RecordingFailed when it cannot be made.
    """
    try:
        if keep is not None:
            make_new_folder(keep)
        folder = keep or Path(tempfile.mkdtemp(prefix="verify-stepbus-"))
    except OSError as exc:
        raise RecordingFailed(
            f"cannot make the folder {keep}: {exc.strerror}; choose a new one with --keep"
        ) from exc
    try:
        yield folder
    except BaseException:
        with contextlib.suppress(OSError):
            folder.rmdir()
        raise


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
