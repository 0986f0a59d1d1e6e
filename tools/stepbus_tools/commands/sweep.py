"""`stepbus sweep`: many runs of one scenario, and one table of them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from stepbus import sweep
from stepbus_orchestrator.cli.output import Answer, say
from stepbus_orchestrator.cli.parameters import Json, command, number
from stepbus_orchestrator.cli.signals import interruptible, settle
from stepbus_tools.sweep.rows import TABLE_FILE
from stepbus_tools.sweep.run_sweep import RUNNING, SweepProgress, SweepResult

_PLAIN_EVERY = 0.1


def _value(text: str) -> int | str:
    """Return an integer; what is none is told with all that is wrong with the sweep."""
    try:
        return int(text)
    except ValueError:
        return text


_WHOLE = {"type": _value}


@command(
    of=sweep,
    hidden=["on_progress"],
    is_run=True,
    vary={"flag": "--vary", "metavar": "AXIS"},
    samples=_WHOLE,
    sampling={"choices": None},
    seed=_WHOLE,
    repeats=_WHOLE,
    metrics={"flag": "--metric", "metavar": "FILE.py:FUNCTION"},
    optimize={"metavar": "METRIC"},
    trials=_WHOLE,
    batch=_WHOLE,
    jobs={"type": number("not a number of processes", 1)},
    timeout_s={
        "flag": "--timeout",
        "type": number("no number of seconds above 0, e.g. 60", 1e-9, kind=float),
        "metavar": "S",
    },
    retry={"type": number("not a number of times", 0), "metavar": "N"},
)
def sweep_command(*, json: Json = False, **given: Any) -> Answer:
    """Run a scenario many times with other values, and make one table.

    Runs a scenario once for each combination of the values that you vary, on all cores or on a Ray
    cluster, and writes one row a run to results.parquet: the values, how the run ended, metrics,
    and the SHA-256 of its recording. The same command goes on with a sweep that was cut off. A run
    that fails is a row; the exit code is 0 once every run has its row.

    $ stepbus sweep two_link --vary controller.params.kp=50:200:7
    $ stepbus sweep two_link --vary 'controller.params.kp~uniform(50, 150)' --samples 100
    $ stepbus sweep two_link --vary controller.params.kp=10:400:log --optimize rmse --trials 40
    $ stepbus sweep my_sweep.yaml --out sweeps/friction --keep all
    """
    with interruptible() as interrupt, _shown(quiet=json) as show:
        result = sweep(**given, on_progress=show, interrupt=interrupt)
        settle()
    return Answer(value=result, lines=_summary(result))


@contextmanager
def _shown(*, quiet: bool) -> Iterator[Callable[[SweepProgress], None]]:
    """Yield what shows the progress: a bar, or a line every tenth of it."""
    console = Console()
    if quiet:
        yield lambda _progress: None
        return
    if not console.is_terminal:
        yield _Lines().show
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[pace]}"),
        TextColumn("{task.fields[failed]} failed"),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("sweep", total=None, pace="", failed=0)

        def show(progress: SweepProgress) -> None:
            bar.update(
                task,
                total=progress.total,
                completed=progress.done,
                pace=_pace(progress),
                failed=progress.failed,
            )

        yield show


class _Lines:
    """Prints a line for each tenth of a sweep, and one for each thing that takes its time."""

    def __init__(self) -> None:
        self._shown = 0.0

    def show(self, progress: SweepProgress) -> None:
        if progress.phase != RUNNING:
            say(progress.phase)
            return
        share = progress.done / progress.total
        if share - self._shown < _PLAIN_EVERY and progress.done < progress.total:
            return
        self._shown = share
        pace = f", {_pace(progress)}" if progress.rate is not None else ""
        say(f"{progress.done} of {progress.total} runs, {progress.failed} failed{pace}")


def _pace(progress: SweepProgress) -> str:
    """Return what happens, or how fast runs come and how long the rest takes, where known."""
    if progress.phase != RUNNING or progress.rate is None or progress.remaining_s is None:
        return "" if progress.phase == RUNNING else progress.phase
    rate = progress.rate
    shown = f"{rate:.1f} runs/s" if rate >= 1 else f"{1 / rate:.1f} s/run"
    left = f", {progress.remaining_s:.0f} s left" if progress.done < progress.total else ""
    return f"{shown}{left}"


def _summary(result: SweepResult) -> Iterator[str]:
    made = result.done - result.resumed
    before = f", {result.resumed} were there before" if result.resumed else ""
    yield f"{made} runs in {result.wall_s:.1f} s{before}; {result.failed} of {result.total} failed"
    yield from (f"  {count} {cause}" for cause, count in result.causes.items())
    if result.metric_errors:
        yield f"{result.metric_errors} runs without your metrics: see the column metric_error"
    yield f"table  {result.folder / TABLE_FILE}"
    yield f"page   {result.page}"
