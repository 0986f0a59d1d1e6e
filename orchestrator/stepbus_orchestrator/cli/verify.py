"""`stepbus verify`: the same result under different conditions, or the first step that differs."""

import argparse
import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.verify import TrialResult, Verification, plan, verify
from stepbus_orchestrator.cli.command import Command, add_scenario_arguments, number
from stepbus_orchestrator.cli.output import print_error, say, say_json
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.processes.launcher import is_set
from stepbus_orchestrator.scenario import load
from stepbus_participant import make_new_folder

_RUNS = 5
_SHOWN_HASH = 12


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument(
        "-n",
        type=number("a number of runs, at least 2", 2),
        default=_RUNS,
        help="number of runs in separate processes (default: 5)",
    )
    parser.add_argument(
        "--seed",
        type=number("a seed, a number from 0 on", 0),
        default=0,
        help="seed of the start orders and delays (default: 0)",
    )
    parser.add_argument(
        "--keep", type=Path, metavar="FOLDER", help="keep the runs in this new folder"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")


def _execute(args: argparse.Namespace) -> int:
    scenario = load(args.scenario, args.set)
    folder = _folder(args.keep)
    trials = plan(scenario, args.n, args.seed, in_process=is_set())

    def show(trial: TrialResult) -> None:
        if not args.json:
            say(_line(trial, len(trials)))

    with _removed_if_empty(folder), interruptible() as interrupt:
        verification = verify(
            scenario,
            trials,
            folder,
            seed=args.seed,
            on_result=show,
            interrupt=interrupt,
            owns_descriptors=is_set(),
        )
    if args.json:
        say_json(_fields(verification))
    else:
        _conclude(verification)
    if args.keep is None and not verification.failed and not verification.different:
        shutil.rmtree(folder)
    elif not args.json:
        say(f"the runs are in {folder}")
    return _code(verification)


@contextlib.contextmanager
def _removed_if_empty(folder: Path) -> Iterator[None]:
    """Remove the folder where the first run could not even begin."""
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):
            folder.rmdir()
        raise


def _folder(keep: Path | None) -> Path:
    """Make the folder of the runs; raises RecordingFailed when that cannot be done."""
    if keep is None:
        return Path(tempfile.mkdtemp(prefix="verify-stepbus-"))
    try:
        make_new_folder(keep)
    except OSError as exc:
        raise RecordingFailed(
            f"cannot make the folder {keep}: {exc.strerror}; choose a new one with --keep"
        ) from exc
    return keep


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


def _conclude(verification: Verification) -> None:
    first = verification.results[0].result
    if verification.failed:
        print_error(verification.failed.result.reason)
    elif verification.different:
        one, other = verification.different
        print_error(
            f"run {other.trial.number} differs from run {one.trial.number}: the same scenario "
            "gave two results"
        )
        say(diff(one.result.recording, other.result.recording).text())
    else:
        say(
            f"{len(verification.results)} runs of {first.steps} steps, one result\n{first.hashes()}"
        )


def _code(verification: Verification) -> int:
    if verification.failed:
        return verification.failed.result.exit_code
    return ExitCode.DIFFERENT if verification.different else ExitCode.FINISHED


def _fields(verification: Verification) -> dict[str, object]:
    difference = None
    if verification.different:
        one, other = verification.different
        difference = diff(one.result.recording, other.result.recording)
    return {"equal": not _code(verification), "diff": difference, "runs": verification.results}


COMMAND = Command(
    name="verify",
    summary="run a scenario several times and compare the recordings",
    description="Runs a scenario several times: once as it is, then with shuffled start order, "
    "random delays in every participant, and other windows and transports, and last with all "
    "participants in one process, where they can share one. All recordings must "
    "be equal byte for byte. Exit code 10: two differ; the first difference is shown.",
    examples=(
        "stepbus verify two_link",
        "stepbus verify two_link -n 10 --set duration=2s --seed 1",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
