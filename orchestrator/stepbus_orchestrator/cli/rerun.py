"""`stepbus rerun`: repeat a run from nothing but its recording."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.diff import Diff
from stepbus_orchestrator.cli.command import Command, number
from stepbus_orchestrator.cli.live import displayed
from stepbus_orchestrator.cli.output import print_error, say, say_json
from stepbus_orchestrator.cli.parameters import add_parameters
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.trust import add_trust, trusted_programs
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.plugins import RERUNS, points
from stepbus_orchestrator.recording.layout import RUN_FILE, recording_file
from stepbus_orchestrator.replay.rerun import Preparation, Rerun, rerun
from stepbus_orchestrator.run.result import Result
from stepbus_schemas import WiringError


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_parameters(
        parser,
        rerun,
        recording={"help": "the run.mcap of a run, its folder, or that of a sweep"},
        out={"flag": "--out", "help": "folder of the new run (default: in runs/)"},
    )
    parser.add_argument(
        "row", type=number("the number of a run", 0), nargs="?", help="which run of a sweep"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    add_trust(parser)


def _execute(args: argparse.Namespace) -> int:
    if rerun_row := _rerun_row(args.recording):
        return _execute_row(args, rerun_row)
    if args.row is not None:
        raise WiringError(f"{args.recording} holds no sweep, so it has no run {args.row}")
    trusted = trusted_programs(args)
    out = args.out or _default(args.recording)
    preparation = Preparation(args.recording, out, args.set, trusted=trusted)
    if not args.json:
        _warn(preparation.notes)
    title = preparation.scenario.name
    with displayed(title, quiet=args.json) as display, interruptible() as interrupt:
        done = preparation.run(display, interrupt)
    difference = None if done.equal or not done.compares else done.diff()
    if args.json:
        say_json(_fields(done, difference))
    else:
        _warn(done.notes[len(preparation.notes) :])
        _conclude(done, difference)
    if done.result.exit_code:
        return done.result.exit_code
    if not done.compares:
        return ExitCode.RECORDING
    return ExitCode.FINISHED if difference is None or difference.equal else ExitCode.DIFFERENT


def _rerun_row(folder: Path) -> Callable[..., Any] | None:
    """Return what repeats a run of a folder with many, such as a sweep; None: it is no such one."""
    if not folder.is_dir():
        return None
    return next((p.load() for p in points(RERUNS) if (folder / p.name).is_file()), None)


def _execute_row(args: argparse.Namespace, rerun_row: Callable[..., Any]) -> int:
    """Do one run of a sweep again, and compare."""
    if args.row is None or args.set:
        raise WiringError(f"{args.recording} is a sweep: give the number of a run, and no --set")
    out = args.out or _default(args.recording / f"{args.recording.resolve().name}-{args.row}")
    title = f"run {args.row}"
    with displayed(title, quiet=args.json) as display, interruptible() as interrupt:
        again = rerun_row(args.recording, args.row, out, display, interrupt)
    result: Result = again.result
    if args.json:
        say_json({"equal": again.equal, "row": again.row, "result": result})
    elif again.equal and result.steps:
        say(f"{result.steps} steps, byte for byte as in the sweep\n{result.hashes()}")
    else:
        say(f"sha256    {result.sha256}, in the sweep {again.row.sha256 or 'none'}")
    if not args.json:
        say(f"recording {result.recording}")
    return ExitCode.FINISHED if again.equal else result.exit_code or ExitCode.DIFFERENT


def _default(recording: Path) -> Path:
    """Return a new folder in runs/, named after the recorded run and numbered."""
    path = recording_file(recording).absolute()
    stem = f"{path.parent.name if path.name == RUN_FILE else path.stem}-rerun"
    names = [stem, *(f"{stem}-{number}" for number in range(2, 1000))]
    return next(Path("runs") / name for name in names if not (Path("runs") / name).exists())


def _warn(notes: Sequence[str]) -> None:
    for note in notes:
        say(f"note: {note}")


def _conclude(rerun: Rerun, difference: Diff | None) -> None:
    result = rerun.result
    if result.exit_code:
        print_error(result.reason)
    if not rerun.compares:
        empty = "this run made" if rerun.recorded_steps else "the recording has"
        say(f"{empty} no complete step: nothing was compared")
    elif rerun.equal or difference is None:
        say(f"{result.steps} steps, byte for byte as recorded\n{result.hashes()}")
    elif difference.equal and rerun.is_part:
        say(
            f"every message of the recording is as recorded: {rerun.recorded_steps} steps, after "
            f"which it {_ending(rerun)}; this run made {result.steps}"
        )
    elif difference.equal:
        say(f"{result.steps} steps, every message as recorded; only the notes above differ")
        say(f"messages  {result.messages_sha256}")
    else:
        say(f"{rerun.recording} and {result.recording} differ:\n{difference.text()}")
    say(f"recording {result.recording}")


def _ending(rerun: Rerun) -> str:
    """Return how a recording ends that is a part of the run."""
    return "is cut off or incomplete" if rerun.flaws else "ends early"


def _fields(rerun: Rerun, difference: Diff | None) -> dict[str, object]:
    return {
        "equal": rerun.equal,
        "messages_equal": rerun.equal or (difference is not None and difference.equal),
        "recorded_steps": rerun.recorded_steps,
        "diff": difference,
        "notes": rerun.notes,
        "recorded_sha256": rerun.recorded_sha256,
        "result": rerun.result,
    }


COMMAND = Command(
    name="rerun",
    summary="repeat a run from nothing but its recording",
    description="Extracts the scenario and its files from a recording into <out>/source, runs "
    "them, and compares the new recording with the old one, byte for byte. Lists what differs on "
    "this machine. Exit code 0: every message is equal, 10: one differs. A recording contains "
    "programs: those that are not in your work tree are shown first; they need a yes, or --trust.",
    examples=(
        "stepbus rerun runs/two_link-20250101-120000/run.mcap",
        "stepbus rerun run.mcap --set window=1 --out /tmp/again",
        "stepbus rerun sweeps/two_link 17",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
