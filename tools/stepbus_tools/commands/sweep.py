"""`stepbus sweep`: many runs of one scenario, and one table of them."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from stepbus_orchestrator.cli import (
    Command,
    add_overrides,
    interruptible,
    number,
    say,
    say_json,
    seconds,
    settle,
)
from stepbus_tools.sweep import (
    KEEP,
    PAGE_FILE,
    RUNNING,
    TABLE_FILE,
    Spec,
    SweepProgress,
    SweepResult,
    Terms,
    default_name,
    find_spec,
    sweep,
)

_PLAIN_EVERY = 0.1


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenario",
        help="a scenario, as of `stepbus run`, or the YAML file of a sweep "
        "(docs/guide/running/sweeps.md)",
    )
    add_overrides(parser, "what is the same in all runs, e.g. duration=2s; may be repeated")
    _add_design(parser)
    _add_optimizer(parser)
    _add_terms(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")


def _add_design(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--vary",
        action="append",
        metavar="AXIS",
        help="PATH=50:200:7, PATH=1:1000:4:log, PATH=a,b,c, 'PATH~normal(1, 0.1)', "
        "'PATH=1,2 & PATH=3,4' (together), 'faults=none,kill plant at 100'; may be repeated",
    )
    parser.add_argument("--samples", type=_value, help="draws of each ~")
    parser.add_argument("--sampling", help="how they are drawn: random, latin, sobol or halton")
    parser.add_argument("--seed", type=_value, help="of the draws")
    parser.add_argument("--repeats", type=_value, help="runs of each point, other seeds")
    parser.add_argument(
        "--metric",
        action="append",
        metavar="FILE.py:FUNCTION",
        help="measure each run by your function of its recording; may be repeated",
    )


def _add_optimizer(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--optimize", metavar="METRIC", help="let Optuna choose the points; axes: PATH=50:200[:log]"
    )
    parser.add_argument("--maximize", action="store_true", default=None, help="make it large")
    parser.add_argument("--trials", type=_value, help="runs of --optimize")
    parser.add_argument("--batch", type=_value, help="runs asked for at once (default: 4)")


def _add_terms(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, help="folder of the sweep (default: one in sweeps/)")
    parser.add_argument(
        "--jobs", type=number("a number of processes", 1), default=0, help="default: all cores"
    )
    parser.add_argument("--keep", choices=KEEP, default="failed", help="recordings that stay")
    parser.add_argument("--timeout", type=seconds, default=0.0, metavar="S", help="limit of a run")
    parser.add_argument(
        "--retry",
        type=number("a number of times", 0),
        default=0,
        metavar="N",
        help="repeat a run that failed to start, died or was late",
    )
    parser.add_argument("--address", default="", help="of a Ray cluster, e.g. auto or HOST:6379")


def _execute(args: argparse.Namespace) -> int:
    spec = _spec(args)
    home = args.out or Path("sweeps") / default_name(spec)
    terms = Terms(
        home=home,
        jobs=args.jobs,
        keep=args.keep,
        timeout_s=args.timeout,
        retries=args.retry,
        address=args.address,
    )
    with interruptible() as interrupt, _shown(quiet=args.json) as show:
        result = sweep(spec, terms, show, interrupt)
        settle()
    if args.json:
        say_json(result)
    else:
        _summarise(result)
    return 0


def _spec(args: argparse.Namespace) -> Spec:
    given = {
        "set": args.set,
        "vary": args.vary,
        "samples": args.samples,
        "sampling": args.sampling,
        "seed": args.seed,
        "repeats": args.repeats,
        "metrics": args.metric,
        "optimize": args.optimize,
        "maximize": args.maximize,
        "trials": args.trials,
        "batch": args.batch,
    }
    # `--set` is an empty list where it is not given.
    options: dict[str, Any] = {k: v for k, v in given.items() if v not in (None, [])}
    return find_spec(args.scenario, options)


def _value(text: str) -> int | str:
    """Return an integer; what is none is told with all that is wrong with the sweep."""
    try:
        return int(text)
    except ValueError:
        return text


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


def _summarise(result: SweepResult) -> None:
    made = result.done - result.resumed
    before = f", {result.resumed} were there before" if result.resumed else ""
    say(f"{made} runs in {result.wall_s:.1f} s{before}; {result.failed} of {result.total} failed")
    for cause, count in result.causes.items():
        say(f"  {count} {cause}")
    if result.metric_errors:
        say(f"{result.metric_errors} runs without your metrics: see the column metric_error")
    say(f"table  {result.folder / TABLE_FILE}\npage   {result.folder / PAGE_FILE}")


COMMAND = Command(
    name="sweep",
    summary="run a scenario many times with other values, and make one table",
    description="Runs a scenario once for each combination of the values that you vary, on all "
    "cores or on a Ray cluster, and writes one row a run to results.parquet: the values, how the "
    "run ended, metrics, and the SHA-256 of its recording. The same command goes on with a sweep "
    "that was cut off. A run that fails is a row; the exit code is 0 once every run has its row.",
    examples=(
        "stepbus sweep two_link --vary controller.params.kp=50:200:7",
        "stepbus sweep two_link --vary 'controller.params.kp~uniform(50, 150)' --samples 100",
        "stepbus sweep two_link --vary controller.params.kp=10:400:log --optimize rmse --trials 40",
        "stepbus sweep my_sweep.yaml --out sweeps/friction --keep all",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
