"""`stepbus branch`: a recording up to a step, and from there a run with a change."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.diff import Diff
from stepbus_orchestrator.cli.after_run import after_run_lines
from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.live import displayed
from stepbus_orchestrator.cli.output import print_error, say, say_json
from stepbus_orchestrator.cli.parameters import add_parameters
from stepbus_orchestrator.cli.signals import abortable, interruptible
from stepbus_orchestrator.cli.trust import add_trust, trusted_programs
from stepbus_orchestrator.errors import ExitCode, OutputExists
from stepbus_orchestrator.plugins import view
from stepbus_orchestrator.recording.layout import RUN_FILE, recording_file
from stepbus_orchestrator.replay.branch import Branch, BranchPlan, Variant, branch, variants
from stepbus_participant import ExtraMissing
from stepbus_schemas import WiringError

_PICTURE = "variants.png"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_parameters(
        parser,
        branch,
        out={"flag": "--out", "type": Path, "help": "folder of the new run (default: in runs/)"},
        at={"required": True, "metavar": "STEP"},
        calls={"flag": "--call", "metavar": "CALL"},
        faults={"flag": "--fault", "metavar": "FAULT"},
        checkpoints={
            "flag": "--no-checkpoints",
            "action": "store_false",
            "help": "repeat all from step 0, whatever the run has saved",
        },
    )
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="PATH=VALUE,VALUE",
        help="make one branch for each value, and one picture of all; may be repeated",
    )
    parser.add_argument(
        "--plot",
        action="append",
        default=[],
        metavar="SIGNAL",
        help="what the picture shows, as of `stepbus plot`; default: the errors of the joints",
    )
    parser.add_argument(
        "--debug",
        action="append",
        default=[],
        metavar="PARTICIPANT",
        help="give a participant this terminal and no deadlines, for a debugger",
    )
    parser.add_argument(
        "--no-report", action="store_true", help="make no report.html and no report.png"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    add_trust(parser)


def _execute(args: argparse.Namespace) -> int:
    trusted = trusted_programs(args)
    out = args.out or _default(args.recording, args.at)
    if args.vary:
        return _execute_variants(args, out, trusted)
    branch = _make(args, out, args.set, trusted)
    difference = _difference(branch)
    if args.json:
        say_json(_fields(branch, difference))
    else:
        _conclude(branch, difference, has_plots=not args.no_report)
    return _code(branch, difference, args)


def _make(
    args: argparse.Namespace, out: Path, overrides: Sequence[str], trusted: str, name: str = ""
) -> Branch:
    plan = BranchPlan(
        args.recording,
        args.at,
        out,
        overrides,
        faults=args.faults,
        calls=args.calls,
        trusted=trusted,
        checkpoints=args.checkpoints,
    )
    if not args.json:
        for note in plan.notes:
            say(f"note: {note}")
    title = f"{plan.scenario.name} from step {plan.at}{name and f', {name}'}"
    with (
        displayed(title, quiet=args.json, plain=bool(args.debug)) as display,
        interruptible() as interrupt,
    ):
        return plan.run(
            display,
            interrupt,
            debug=args.debug,
            in_process=args.in_process,
            owns_descriptors=args.in_process and not args.debug,
        )


def _default(recording: Path, at: str) -> Path:
    """Return a new folder in runs/, named after the recorded run and the step."""
    path = recording_file(recording).absolute()
    stem = f"{path.parent.name if path.name == RUN_FILE else path.stem}-at-{at}"
    names = [stem, *(f"{stem}-{number}" for number in range(2, 1000))]
    return next(Path("runs") / name for name in names if not (Path("runs") / name).exists())


def _difference(branch: Branch) -> Diff | None:
    """Return how a branch differs from its recording; None where it has the same bytes, or none."""
    if branch.result.exit_code or branch.equal:
        return None
    return branch.diff()


def _code(branch: Branch, difference: Diff | None, args: argparse.Namespace) -> int:
    """Return the exit code: a branch without a change has to have the same messages."""
    if branch.result.exit_code:
        return branch.result.exit_code
    is_changed = args.set or args.calls or args.faults or args.vary
    is_equal = difference is None or difference.equal
    return ExitCode.FINISHED if is_changed or is_equal else ExitCode.DIFFERENT


def _conclude(branch: Branch, difference: Diff | None, *, has_plots: bool) -> None:
    result = branch.result
    if result.exit_code:
        print_error(result.reason)
    if branch.way_s:
        rate = branch.at / branch.way_s
        say(f"live from step {branch.at}; {branch.way_s:.2f} s to get there ({rate:.0f} steps/s)")
    if branch.restored:
        rows = (f"{name} from step {step}" for name, step in branch.restored.items())
        say(f"checkpoints: {', '.join(rows)}")
    if difference is not None:
        why = "" if result.reason == "finished" else f" ({result.reason})"
        say(f"{result.scenario}: finished{why} after {result.steps} steps")
        for line in _differences(difference):
            say(line)
    elif branch.equal and result.steps:
        say(f"{result.steps} steps, byte for byte as recorded")
    if has_plots and result.recording.exists() and result.steps:
        with abortable():
            for line in after_run_lines(result.recording, has_plots=True):
                say(line)
    say(f"recording {result.recording}\n{result.hashes()}")


def _differences(difference: Diff) -> Iterator[str]:
    """Yield where a branch leaves its recording, or else what beside the messages differs."""
    if difference.divergence is not None:
        yield f"leaves the recording at {difference.divergence.text('recorded', 'now')}"
    elif difference.equal:
        yield "every message is as recorded, though the files differ"
        yield from (f"note: {note}" for note in difference.notes)


def _fields(branch: Branch, difference: Diff | None) -> dict[str, Any]:
    return {
        "at": branch.at,
        "changed": list(branch.changed),
        "equal": branch.equal,
        "messages_equal": branch.equal or (difference is not None and difference.equal),
        "way_s": branch.way_s,
        "restored": dict(branch.restored),
        "notes": list(branch.notes),
        "recorded_sha256": branch.recorded_sha256,
        "result": branch.result,
    }


def _execute_variants(args: argparse.Namespace, out: Path, trusted: str) -> int:
    chosen = variants(args.vary)
    if out.exists() and any(out.iterdir()):
        raise OutputExists(f"{out} is not empty; choose another --out")
    if args.debug:
        raise WiringError("--debug: choose one of the variants, with --set")
    branches: list[tuple[Variant, Branch]] = []
    for variant in chosen:
        overrides = [*args.set, *variant.overrides]
        branch = _make(args, out / variant.folder, overrides, trusted, variant.name)
        branches.append((variant, branch))
        if not args.json:
            _say_variant(variant, branch)
        if branch.result.exit_code == ExitCode.INTERRUPTED:
            break
    picture = None if args.no_report else _picture(args, out, branches)
    if args.json:
        rows = [
            {"variant": variant.name, **_fields(branch, _difference(branch))}
            for variant, branch in branches
        ]
        say_json({"variants": rows, "picture": picture})
    elif picture is not None:
        say(f"picture   {picture}")
    return max((_code(branch, None, args) for _, branch in branches), default=ExitCode.FINISHED)


def _say_variant(variant: Variant, branch: Branch) -> None:
    result = branch.result
    if result.exit_code:
        print_error(f"{variant.name}: {result.reason}")
    say(f"{variant.name}: {result.outcome} after {result.steps} steps, {result.recording}")


def _picture(
    args: argparse.Namespace, out: Path, branches: Sequence[tuple[Variant, Branch]]
) -> str | None:
    """Draw the variants that have anything to draw; return the picture's path."""
    drawn = {v.name: b.result.recording for v, b in branches if b.result.steps > b.at}
    if not drawn:
        return None
    target = out / _PICTURE
    try:
        at = branches[0][1].at
        view("variants")(args.recording, drawn, target, at=at, signals=args.plot)
    except ExtraMissing as exc:
        say(f"no picture: {exc}")
        return None
    return str(target)


COMMAND = Command(
    name="branch",
    summary="branch a recording: live again from a step on, with a change",
    description="Takes a recording up to a step, and goes on from there as a live run, with what "
    "you change. Up to the step, every participant gets its recorded inputs, as fast as it takes "
    "them, and has to publish what is recorded; the first that does not is named (exit code 10). "
    "Without a change, the new recording is the old one, byte for byte. A changed participant "
    "gets its recorded inputs too; its own outputs count from the step on. A recording contains "
    "programs: those that are not in your work tree are shown first; they need a yes, or --trust.",
    examples=(
        "stepbus branch run.mcap --at 1200",
        "stepbus branch run.mcap --at 6s --set controller.params.kp=90",
        "stepbus branch run.mcap --at 1200 --vary controller.params.kp=50,100,200",
        "stepbus branch run.mcap --at 1200 --fault 'freeze plant at 1300 for 200ms'",
        "stepbus branch run.mcap --at 1200 --debug controller",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
