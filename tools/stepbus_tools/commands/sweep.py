"""`stepbus sweep`: many runs of one scenario, and one table of them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from stepbus_orchestrator.cli.output import Answer, say
from stepbus_orchestrator.cli.parameters import Json, Set, command, number
from stepbus_orchestrator.cli.signals import interruptible, settle
from stepbus_tools.sweep import (
    PAGE_FILE,
    RUNNING,
    TABLE_FILE,
    SweepProgress,
    SweepResult,
    Terms,
    default_name,
    find_spec,
    sweep,
)

_PLAIN_EVERY = 0.1


def _value(text: str) -> int | str:
    """Return an integer; what is none is told with all that is wrong with the sweep."""
    try:
        return int(text)
    except ValueError:
        return text


Whole = Annotated[int | None, {"type": _value}]


@dataclass(frozen=True, kw_only=True)
class Design:
    """What replaces a part of a sweep's file, or makes a sweep of a scenario.

    set: what is the same in all runs, e.g. duration=2s; may be repeated. vary: PATH=50:200:7,
    PATH=1:1000:4:log, PATH=a,b,c, 'PATH~normal(1, 0.1)', 'PATH=1,2 & PATH=3,4' (together),
    'faults=none,kill plant at 100'; may be repeated. samples: draws of each ~. sampling: how they
    are drawn: random, latin, sobol or halton. seed: of the draws. repeats: runs of each point,
    other seeds. metrics: measure each run by your function of its recording; may be repeated.
    optimize: let Optuna choose the points; axes: PATH=50:200[:log]. maximize: make it large.
    trials: runs of --optimize. batch: runs asked for at once (default: 4).
    """

    set: Set = ()
    vary: Annotated[Sequence[str], {"metavar": "AXIS"}] = ()
    samples: Whole = None
    sampling: str | None = None
    seed: Whole = None
    repeats: Whole = None
    metrics: Annotated[Sequence[str], {"flag": "--metric", "metavar": "FILE.py:FUNCTION"}] = ()
    optimize: Annotated[str | None, {"metavar": "METRIC"}] = None
    maximize: bool = False
    trials: Whole = None
    batch: Whole = None


_JOBS = {"type": number("not a number of processes", 1)}
_SECONDS = {
    "type": number("no number of seconds above 0, e.g. 60", 1e-9, kind=float),
    "metavar": "S",
}
_TIMES = {"type": number("not a number of times", 0), "metavar": "N"}


@command(is_run=True)
def sweep_command(
    scenario: str,
    *,
    design: Design,
    out: Path | None = None,
    jobs: Annotated[int | None, _JOBS] = None,
    keep: Literal["all", "failed", "none"] = "failed",
    timeout: Annotated[float | None, _SECONDS] = None,
    retry: Annotated[int, _TIMES] = 0,
    address: str = "",
    json: Json = False,
) -> Answer:
    """Run a scenario many times with other values, and make one table.

    Runs a scenario once for each combination of the values that you vary, on all cores or on a Ray
    cluster, and writes one row a run to results.parquet: the values, how the run ended, metrics,
    and the SHA-256 of its recording. The same command goes on with a sweep that was cut off. A run
    that fails is a row; the exit code is 0 once every run has its row.

    scenario: a scenario, as of `stepbus run`, or the YAML file of a sweep
    (docs/guide/running/sweeps.md). out: folder of the sweep (default: one in sweeps/). jobs:
    default: all cores. keep: recordings that stay. timeout: limit of a run. retry: repeat a run
    that failed to start, died or was late. address: of a Ray cluster, e.g. auto or HOST:6379.

    $ stepbus sweep two_link --vary controller.params.kp=50:200:7
    $ stepbus sweep two_link --vary 'controller.params.kp~uniform(50, 150)' --samples 100
    $ stepbus sweep two_link --vary controller.params.kp=10:400:log --optimize rmse --trials 40
    $ stepbus sweep my_sweep.yaml --out sweeps/friction --keep all
    """
    # 0 is a value, such as of `--seed`.
    given = {k: v for k, v in vars(design).items() if v is not None and v is not False and v != []}
    spec = find_spec(scenario, given)
    terms = Terms(
        home=out or Path("sweeps") / default_name(spec),
        jobs=jobs or 0,
        keep=keep,
        timeout_s=timeout or 0.0,
        retries=retry,
        address=address,
    )
    with interruptible() as interrupt, _shown(quiet=json) as show:
        result = sweep(spec, terms, show, interrupt)
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
    yield f"page   {result.folder / PAGE_FILE}"
