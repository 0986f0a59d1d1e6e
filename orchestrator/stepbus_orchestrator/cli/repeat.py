"""`stepbus rerun` and `branch`: a run again from its recording, whole or with a change."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.diff import Diff
from stepbus_orchestrator.analysis.divergence import port_lines
from stepbus_orchestrator.cli import commands
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.run_command import after_run
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer, print_error, say
from stepbus_orchestrator.errors import ExitCode, OutputExists, Untrusted, indented
from stepbus_orchestrator.plugins import RERUNS, points, view
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.layout import RUN_FILE, recording_file
from stepbus_orchestrator.replay.branch import Branch, BranchPlan
from stepbus_orchestrator.replay.branch_change import variants
from stepbus_orchestrator.replay.rerun import Preparation, Rerun
from stepbus_orchestrator.replay.sources import Recorded
from stepbus_orchestrator.replay.trust import programs_of
from stepbus_participant import ExtraMissing
from stepbus_schemas import WiringError

_PICTURE = "variants.png"
_UNFIT = re.compile(r"[^A-Za-z0-9._=+-]+")


def check_trust(
    opened: Recorded, participant: str | None = None, *, trust: bool, own_program: bool = False
) -> None:
    """Raise Untrusted for programs that are not the user's, unless `trust`; name edited files."""
    programs = programs_of(opened, participant, own_program=own_program)
    if not (programs.is_yours or trust):
        rows = "\n".join(f"  {indented(line)}" for line in programs.lines())
        raise Untrusted(
            f"{opened.path} contains programs that are not those of your scenario. They would run "
            f"with your permissions:\n{rows}\nnothing was started; if you trust these programs, "
            "use --trust"
        )
    for note in programs.notes():
        print_error(note)


def _new_folder(recording: Path, suffix: str) -> Path:
    """Return a new folder in runs/, named after the recorded run and numbered."""
    path = recording_file(recording).absolute()
    stem = f"{path.parent.name if path.name == RUN_FILE else path.stem}-{suffix}"
    names = [stem, *(f"{stem}-{number}" for number in range(2, 1000))]
    return next(Path("runs") / name for name in names if not (Path("runs") / name).exists())


def _say_notes(notes: Sequence[str], *, quiet: bool) -> None:
    for note in () if quiet else notes:
        say(f"note: {note}")


# --- rerun -------------------------------------------------------------------------------------


def rerun_command(given: commands.Rerun) -> Answer:
    """Repeat a run, or one of a sweep, and return whether it is the same."""
    recording, row, out = given.recording, given.row, given.out
    if run_of := _run_of(recording):
        if row is None or given.set:
            raise WiringError(
                f"{recording} is a sweep: give the number of one of its runs, without --set"
            )
        recorded = run_of(recording, row)
        check_trust(recorded, trust=given.trust)
        out = out or _new_folder(recording / f"{recording.resolve().name}-{row}", "rerun")
        with displayed(f"run {row}", quiet=given.json) as display, interruptible() as interrupt:
            return _answer_of_row(recorded.run(out, display, interrupt))
    if row is not None:
        raise WiringError(f"{recording} is not a sweep, so it has no run {row}")
    check_trust(Recording(recording), trust=given.trust)
    preparation = Preparation(recording, out or _new_folder(recording, "rerun"), given.set)
    _say_notes(preparation.notes, quiet=given.json)
    title = preparation.scenario.name
    with displayed(title, quiet=given.json) as display, interruptible() as interrupt:
        done = preparation.run(display, interrupt)
    return _rerun_answer(done, done.notes[len(preparation.notes) :])


def _run_of(folder: Path) -> Callable[..., Any] | None:
    """Return the function that finds a run in a folder of many, such as a sweep; None: not one."""
    if not folder.is_dir():
        return None
    return next((p.load() for p in points(RERUNS) if (folder / p.name).is_file()), None)


def _answer_of_row(again: Any) -> Answer:
    """Return whether one run of a sweep is the same, and write its page."""
    result = again.result
    is_equal = again.equal and result.steps
    hashes = f"sha256    {result.sha256}, in the sweep {again.row.sha256 or 'none'}"
    return Answer(
        value={"equal": again.equal, "row": again.row, "result": result},
        lines=[
            *([f"{result.steps} steps, byte for byte as in the sweep"] if is_equal else []),
            *after_run(result, has_plots=True),
            f"recording {result.recording}",
            result.hashes() if is_equal else hashes,
        ],
        code=ExitCode.FINISHED if again.equal else result.exit_code or ExitCode.DIFFERENT,
    )


def _rerun_answer(rerun: Rerun, notes: Sequence[str]) -> Answer:
    """Return whether a run is the same; notes: of what came up since it began."""
    result = rerun.result
    difference = None if rerun.equal or not rerun.compares else rerun.diff()
    is_equal = rerun.equal or (difference is not None and difference.equal)
    code = ExitCode.FINISHED if difference is None or is_equal else ExitCode.DIFFERENT
    return Answer(
        value={
            "equal": rerun.equal,
            "messages_equal": is_equal,
            "recorded_steps": rerun.recorded_steps,
            "diff": difference,
            "notes": rerun.notes,
            "recorded_sha256": rerun.recorded_sha256,
            "result": result,
        },
        lines=[
            *(f"note: {note}" for note in notes),
            _compared(rerun, difference),
            f"recording {result.recording}",
        ],
        error=result.reason if result.exit_code else "",
        code=result.exit_code or (code if rerun.compares else ExitCode.RECORDING),
    )


def _compared(rerun: Rerun, difference: Diff | None) -> str:
    result = rerun.result
    if not rerun.compares:
        empty = "this run made" if rerun.recorded_steps else "the recording has"
        return f"{empty} no complete step: nothing was compared"
    if difference is None:
        return f"{result.steps} steps, byte for byte as recorded\n{result.hashes()}"
    if not difference.equal:
        return f"{rerun.recording} and {result.recording} differ:\n{difference.text()}"
    if rerun.is_part:
        ending = "is cut off or incomplete" if rerun.flaws else "ends early"
        return (
            f"every message of the recording is as recorded: {rerun.recorded_steps} steps, after "
            f"which it {ending}; this run made {result.steps}"
        )
    return (
        f"{result.steps} steps, every message as recorded; only the notes above differ\n"
        f"messages  {result.messages_sha256}"
    )


# --- branch ------------------------------------------------------------------------------------


def branch_command(given: commands.Branch) -> Answer:
    """Make one branch, or one for each variant, and return how they ended."""
    recording, vary = given.recording, given.vary
    out = given.out or _new_folder(recording, f"at-{given.at}")
    check_trust(Recording(recording), trust=given.trust)
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
        done = branches[name] = _run_branch(plan, name, given)
        if vary and not given.json:
            if done.result.exit_code:
                print_error(f"{name}: {done.result.reason}")
            end = f"{done.result.outcome} after {done.result.steps} steps"
            say(f"{name}: {end}, {done.result.recording}")
        if done.result.exit_code == ExitCode.INTERRUPTED:
            break
    if not vary:
        return _branch_answer(done, given)
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


def _run_branch(plan: BranchPlan, variant: str, given: commands.Branch) -> Branch:
    _say_notes(plan.notes, quiet=given.json)
    title = f"{plan.scenario.name} from step {plan.at}{variant and f', {variant}'}"
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


def _branch_answer(branch: Branch, given: commands.Branch) -> Answer:
    """Return how a branch ended; one without a change has to have the same messages."""
    result, difference = branch.result, _difference(branch)
    is_changed = given.set or given.calls or given.faults
    is_expected = is_changed or difference is None or difference.equal
    return Answer(
        value=_fields(branch, difference),
        lines=_branch_lines(branch, difference, has_plots=not given.no_report),
        error=result.reason if result.exit_code else "",
        code=result.exit_code or (ExitCode.FINISHED if is_expected else ExitCode.DIFFERENT),
    )


def _branch_lines(branch: Branch, difference: Diff | None, *, has_plots: bool) -> Iterator[str]:
    result = branch.result
    if branch.way_s:
        rate = branch.at / branch.way_s
        yield f"live from step {branch.at}; {branch.way_s:.2f} s to reach it ({rate:.0f} steps/s)"
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
