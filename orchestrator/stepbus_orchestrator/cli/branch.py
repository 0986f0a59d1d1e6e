"""`stepbus branch`: a recording up to a step, and from there a run with a change."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.diff import Diff
from stepbus_orchestrator.analysis.divergence import port_lines
from stepbus_orchestrator.cli import commands
from stepbus_orchestrator.cli.rerun import check_trust, new_folder
from stepbus_orchestrator.cli.run import after_run
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer, print_error, say
from stepbus_orchestrator.errors import ExitCode, OutputExists
from stepbus_orchestrator.plugins import view
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.branch import Branch, BranchPlan
from stepbus_orchestrator.replay.branch_change import variants
from stepbus_participant import ExtraMissing
from stepbus_schemas import WiringError

_PICTURE = "variants.png"
_UNFIT = re.compile(r"[^A-Za-z0-9._=+-]+")


def branch_command(given: commands.Branch) -> Answer:
    """Make one branch, or one for each variant, and return what became of them."""
    recording, vary = given.recording, given.vary
    out = given.out or new_folder(recording, f"at-{given.at}")
    check_trust(Recording(recording), trust=given.trust)
    is_changed = bool(given.set or vary or given.calls or given.faults)
    if vary and out.exists() and any(out.iterdir()):
        raise OutputExists(f"{out} is not empty; choose another --out")
    if vary and given.debug:
        raise WiringError("--debug cannot be combined with --vary; choose one value with --set")
    branches: dict[str, Branch] = {}
    for name, overrides in variants(vary).items():
        plan = BranchPlan(
            recording,
            given.at,
            out / _UNFIT.sub("_", name.replace(", ", ",")),
            [*given.set, *overrides],
            calls=given.calls,
            faults=given.faults,
            checkpoints=not given.no_checkpoints,
        )
        done = branches[name] = _run(plan, name, given)
        if vary and not given.json:
            if done.result.exit_code:
                print_error(f"{name}: {done.result.reason}")
            end = f"{done.result.outcome} after {done.result.steps} steps"
            say(f"{name}: {end}, {done.result.recording}")
        if done.result.exit_code == ExitCode.INTERRUPTED:
            break
    if not vary:
        return _answer(done, is_changed=is_changed, has_plots=not given.no_report)
    picture = None if given.no_report else _picture(recording, out, branches, given.plot)
    rows = branches.items() if given.json else ()
    return Answer(
        value={
            "variants": [{"variant": v, **_fields(b, _difference(b))} for v, b in rows],
            "picture": picture,
        },
        lines=[] if picture is None else [f"picture   {picture}"],
        code=max(branch.result.exit_code for branch in branches.values()),
    )


def _run(plan: BranchPlan, variant: str, given: commands.Branch) -> Branch:
    if not given.json:
        for note in plan.notes:
            say(f"note: {note}")
    which = variant and f", {variant}"
    title = f"{plan.scenario.name} from step {plan.at}{which}"
    with (
        displayed(title, quiet=given.json, plain=bool(given.debug)) as display,
        interruptible() as interrupt,
    ):
        return plan.run(
            display,
            interrupt,
            debug=given.debug,
            in_process=given.in_process,
            owns_descriptors=given.in_process and not given.debug,
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


def _picture(
    recording: Path, out: Path, branches: Mapping[str, Branch], signals: Sequence[str]
) -> str | None:
    """Draw the variants that have anything to draw; return the picture's path."""
    drawn = {v: b.result.recording for v, b in branches.items() if b.result.steps > b.at}
    if not drawn:
        return None
    at = max(branch.at for branch in branches.values())
    try:
        view("variants")(recording, drawn, out / _PICTURE, at=at, signals=signals)
    except ExtraMissing as exc:
        say(f"no picture: {exc}")
        return None
    return str(out / _PICTURE)
