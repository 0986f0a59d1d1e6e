"""`stepbus rerun`: repeat a run from nothing but its recording."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.diff import Diff
from stepbus_orchestrator.cli import commands
from stepbus_orchestrator.cli.run import after_run
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer, print_error, say
from stepbus_orchestrator.errors import ExitCode, Untrusted, indented
from stepbus_orchestrator.plugins import RERUNS, points
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.layout import RUN_FILE, recording_file
from stepbus_orchestrator.replay.rerun import Preparation, Rerun
from stepbus_orchestrator.replay.sources import Recorded
from stepbus_orchestrator.replay.trust import programs_of
from stepbus_orchestrator.run.result import Result
from stepbus_schemas import WiringError


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
        out = out or new_folder(recording / f"{recording.resolve().name}-{row}", "rerun")
        with displayed(f"run {row}", quiet=given.json) as display, interruptible() as interrupt:
            return _answer_of_row(recorded.run(out, display, interrupt))
    if row is not None:
        raise WiringError(f"{recording} is not a sweep, so it has no run {row}")
    check_trust(Recording(recording), trust=given.trust)
    out = out or new_folder(recording, "rerun")
    preparation = Preparation(recording, out, given.set)
    if not given.json:
        for note in preparation.notes:
            say(f"note: {note}")
    title = preparation.scenario.name
    with displayed(title, quiet=given.json) as display, interruptible() as interrupt:
        done = preparation.run(display, interrupt)
    return _answer(done, done.notes[len(preparation.notes) :])


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


def new_folder(recording: Path, suffix: str) -> Path:
    """Return a new folder in runs/, named after the recorded run and numbered."""
    path = recording_file(recording).absolute()
    stem = f"{path.parent.name if path.name == RUN_FILE else path.stem}-{suffix}"
    names = [stem, *(f"{stem}-{number}" for number in range(2, 1000))]
    return next(Path("runs") / name for name in names if not (Path("runs") / name).exists())


def _run_of(folder: Path) -> Callable[..., Any] | None:
    """Return what finds a run in a folder with many, such as a sweep; None: it is no such one."""
    if not folder.is_dir():
        return None
    return next((p.load() for p in points(RERUNS) if (folder / p.name).is_file()), None)


def _answer_of_row(again: Any) -> Answer:
    """Return what became of one run of a sweep."""
    result: Result = again.result
    return Answer(
        value={"equal": again.equal, "row": again.row, "result": result},
        lines=_lines_of_row(again),
        code=ExitCode.FINISHED if again.equal else result.exit_code or ExitCode.DIFFERENT,
    )


def _lines_of_row(again: Any) -> Iterator[str]:
    """Yield the summary of one run of a sweep, and write its page."""
    result: Result = again.result
    is_equal = again.equal and result.steps
    if is_equal:
        yield f"{result.steps} steps, byte for byte as in the sweep"
    yield from after_run(result, has_plots=True)
    yield f"recording {result.recording}"
    yield (
        result.hashes()
        if is_equal
        else (f"sha256    {result.sha256}, in the sweep {again.row.sha256 or 'none'}")
    )


def _answer(rerun: Rerun, notes: Sequence[str]) -> Answer:
    """Return what became of a run; notes: what has been noted since it began."""
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
        lines=[*(f"note: {note}" for note in notes), *_compared(rerun, difference)],
        error=result.reason if result.exit_code else "",
        code=result.exit_code or (code if rerun.compares else ExitCode.RECORDING),
    )


def _compared(rerun: Rerun, difference: Diff | None) -> Iterator[str]:
    result = rerun.result
    if not rerun.compares:
        empty = "this run made" if rerun.recorded_steps else "the recording has"
        yield f"{empty} no complete step: nothing was compared"
    elif rerun.equal or difference is None:
        yield f"{result.steps} steps, byte for byte as recorded\n{result.hashes()}"
    elif difference.equal and rerun.is_part:
        ending = "is cut off or incomplete" if rerun.flaws else "ends early"
        yield (
            f"every message of the recording is as recorded: {rerun.recorded_steps} steps, after "
            f"which it {ending}; this run made {result.steps}"
        )
    elif difference.equal:
        yield f"{result.steps} steps, every message as recorded; only the notes above differ"
        yield f"messages  {result.messages_sha256}"
    else:
        yield f"{rerun.recording} and {result.recording} differ:\n{difference.text()}"
    yield f"recording {result.recording}"
