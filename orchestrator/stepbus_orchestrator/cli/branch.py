"""`stepbus branch`: a recording up to a step, and from there a run with a change."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from stepbus_orchestrator.analysis.diff import Diff
from stepbus_orchestrator.analysis.divergence import port_lines
from stepbus_orchestrator.cli.parameters import RECORDING, Json, Trust, command
from stepbus_orchestrator.cli.rerun import OUT, new_folder
from stepbus_orchestrator.cli.run import Names, after_run
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer, print_error, say
from stepbus_orchestrator.cli.trust import check_trust
from stepbus_orchestrator.errors import ExitCode, OutputExists
from stepbus_orchestrator.plugins import view
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.branch import Branch, BranchPlan, branch
from stepbus_orchestrator.replay.branch_change import Variant, variants
from stepbus_participant import ExtraMissing
from stepbus_schemas import WiringError

_PICTURE = "variants.png"


@command(
    group="test",
    of=branch,
    is_run=True,
    recording=RECORDING,
    out=OUT,
    at={"metavar": "STEP"},
    calls={"flag": "--call", "metavar": "CALL"},
    faults={"flag": "--fault", "metavar": "FAULT"},
    checkpoints={
        "flag": "--no-checkpoints",
        "help": "replay from step 0, without the saved checkpoints",
    },
)
def branch_command(
    *,
    vary: Annotated[Sequence[str], {"metavar": "PATH=VALUE,VALUE"}] = (),
    plot: Annotated[Sequence[str], {"metavar": "SIGNAL"}] = (),
    debug: Names = (),
    no_report: bool = False,
    json: Json = False,
    trust: Trust = False,
    **given: Any,
) -> Answer:
    """Replay a recording up to a step, then run live with your changes.

    Replays a recording up to a step, then continues as a live run with your changes. Until that
    step, every participant gets its recorded inputs as fast as it can process them and must publish
    the recorded outputs; the first one that diverges is reported (exit code 10). Without a change,
    the new recording is byte-identical to the old one. A changed participant also gets its recorded
    inputs; its own outputs are used from that step on. A recording contains programs: those
    that are not in your scenario's folder start only with --trust.

    vary: make one branch per value, and one picture of all branches; may be repeated. plot: signal
    in that picture, as in `stepbus plot`; default: the joint errors. debug: run a participant in
    this terminal without deadlines, for a debugger. no_report: do not write report.html and
    report.png.

    $ stepbus branch run.mcap --at 1200
    $ stepbus branch run.mcap --at 6s --set controller.params.kp=90
    $ stepbus branch run.mcap --at 1200 --vary controller.params.kp=50,100,200
    $ stepbus branch run.mcap --at 1200 --fault 'freeze plant at 1300 for 200ms'
    $ stepbus branch run.mcap --at 1200 --debug controller
    """
    recording, overrides, in_process = given["recording"], given.pop("set"), given.pop("in_process")
    out = given.pop("out") or new_folder(recording, f"at-{given['at']}")
    check_trust(Recording(recording), trust=trust)
    is_changed = bool(overrides or vary or given["calls"] or given["faults"])
    if vary and out.exists() and any(out.iterdir()):
        raise OutputExists(f"{out} is not empty; choose another --out")
    if vary and debug:
        raise WiringError("--debug cannot be combined with --vary; choose one value with --set")
    branches: list[tuple[Variant, Branch]] = []
    for variant in variants(vary):
        given["overrides"] = [*overrides, *variant.overrides]
        plan = BranchPlan(**given, out=out / variant.folder)
        done = _run(plan, variant, debug, json=json, in_process=in_process)
        branches.append((variant, done))
        if vary and not json:
            _say_variant(variant, done)
        if done.result.exit_code == ExitCode.INTERRUPTED:
            break
    if not vary:
        return _answer(done, is_changed=is_changed, has_plots=not no_report)
    picture = None if no_report else _picture(recording, out, branches, plot)
    rows = branches if json else ()
    return Answer(
        value={
            "variants": [{"variant": v.name, **_fields(b, _difference(b))} for v, b in rows],
            "picture": picture,
        },
        lines=[] if picture is None else [f"picture   {picture}"],
        code=max(branch.result.exit_code for _, branch in branches),
    )


def _run(
    plan: BranchPlan, variant: Variant, debug: Sequence[str], *, json: bool, in_process: bool
) -> Branch:
    if not json:
        for note in plan.notes:
            say(f"note: {note}")
    which = variant.name and f", {variant.name}"
    title = f"{plan.scenario.name} from step {plan.at}{which}"
    with (
        displayed(title, quiet=json, plain=bool(debug)) as display,
        interruptible() as interrupt,
    ):
        return plan.run(
            display,
            interrupt,
            debug=debug,
            in_process=in_process,
            owns_descriptors=in_process and not debug,
        )


def _difference(branch: Branch) -> Diff | None:
    """Return how a branch differs from its recording; None where it has the same bytes, or none."""
    return None if branch.result.exit_code or branch.equal else branch.diff()


def _answer(branch: Branch, *, is_changed: bool, has_plots: bool) -> Answer:
    """Return what became of a branch; one without a change has to have the same messages."""
    result, difference = branch.result, _difference(branch)
    is_expected = is_changed or difference is None or difference.equal
    return Answer(
        value=_fields(branch, difference),
        lines=_lines(branch, difference, has_plots=has_plots),
        error=result.reason if result.exit_code else "",
        code=result.exit_code or (ExitCode.FINISHED if is_expected else ExitCode.DIFFERENT),
    )


def _lines(branch: Branch, difference: Diff | None, *, has_plots: bool) -> Iterator[str]:
    result = branch.result
    if branch.way_s:
        rate = branch.at / branch.way_s
        yield (f"live from step {branch.at}; {branch.way_s:.2f} s to reach it ({rate:.0f} steps/s)")
    if branch.restored:
        rows = (f"{name} from step {step}" for name, step in branch.restored.items())
        yield f"checkpoints: {', '.join(rows)}"
    if difference is not None:
        why = "" if result.reason == "finished" else f" ({result.reason})"
        yield f"{result.scenario}: finished{why} after {result.steps} steps"
        if difference.divergence is not None:
            text = difference.divergence.text("recording", "branch")
            yield f"diverges from the recording at {text}"
            for port in difference.ports:
                if port.divergence is not None:
                    yield from port_lines(port, "recording", "branch", difference.divergence)
        elif difference.equal:
            yield "all messages equal the recording; the files differ"
            yield from (f"note: {note}" for note in difference.notes)
    elif branch.equal and result.steps:
        yield f"{result.steps} steps, byte for byte as recorded"
    if has_plots:
        yield from after_run(result, has_plots=True)
    yield f"recording {result.recording}\n{result.hashes()}"


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


def _say_variant(variant: Variant, branch: Branch) -> None:
    result = branch.result
    if result.exit_code:
        print_error(f"{variant.name}: {result.reason}")
    say(f"{variant.name}: {result.outcome} after {result.steps} steps, {result.recording}")


def _picture(
    recording: Path, out: Path, branches: Sequence[tuple[Variant, Branch]], signals: Sequence[str]
) -> str | None:
    """Draw the variants that have anything to draw; return the picture's path."""
    drawn = {v.name: b.result.recording for v, b in branches if b.result.steps > b.at}
    if not drawn:
        return None
    at = branches[0][1].at
    try:
        view("variants")(recording, drawn, out / _PICTURE, at=at, signals=signals)
    except ExtraMissing as exc:
        say(f"no picture: {exc}")
        return None
    return str(out / _PICTURE)
