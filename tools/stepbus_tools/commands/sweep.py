"""`stepbus sweep`: many runs of one scenario, and one table of them."""

import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

from stepbus import sweep
from stepbus_orchestrator.cli.parameters import DURATION, Json, command, number
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import Reached, open_screen
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.scenario.override import yaml_text
from stepbus_tools.sweep.rows import TABLE_FILE
from stepbus_tools.sweep.run_sweep import RUNNING, SweepProgress, SweepResult


def _value(text: str) -> int | str:
    """Return an integer; what is none is told with all that is wrong with the sweep."""
    try:
        return int(text)
    except ValueError:
        return text


_WHOLE = {"type": _value}


@command(
    group="many",
    of=sweep,
    hidden=["on_progress"],
    is_run=True,
    scenario={"complete": "scenario"},
    out={"metavar": "FOLDER"},
    vary={"flag": "--vary", "metavar": "AXIS"},
    samples=_WHOLE,
    sampling={"choices": None},
    seed=_WHOLE,
    repeats=_WHOLE,
    metrics={"flag": "--metric", "metavar": "FILE.py:FUNCTION"},
    optimize={"metavar": "METRIC"},
    trials=_WHOLE,
    batch=_WHOLE,
    jobs={"type": number("not a number of processes (1 or more)", 1)},
    timeout_s={
        "flag": "--timeout",
        "help": "time limit of a run, e.g. 90s (default: none)",
        **DURATION,
    },
    retry={"type": number("not a number of retries (0 or more)", 0), "metavar": "N"},
)
def sweep_command(*, json: Json = False, **given: Any) -> Answer:
    """Run a scenario many times with different values, and collect one table.

    Runs a scenario once for each combination of the values that you vary, on all cores or on a Ray
    cluster, and writes one row per run to results.parquet: the values, the outcome, metrics, and
    the SHA-256 of the recording. Run the same command again to resume an interrupted sweep. A
    failed run is a row too; the exit code is 0 once every run has its row.

    $ stepbus sweep two_link --vary controller.params.kp=50:200:7
    $ stepbus sweep two_link --samples 9 --vary 'controller.params.kp~normal(9, 1)'
    $ stepbus sweep two_link --vary controller.params.kp=10:400:log --optimize rmse
    $ stepbus sweep my_sweep.yaml --out sweeps/friction --keep all
    """
    with interruptible(ends=True) as interrupt, _shown(quiet=json) as show:
        result = sweep(**given, on_progress=show, interrupt=interrupt)
    return Answer(value=result, lines=_summary(result))


@contextmanager
def _shown(*, quiet: bool) -> Iterator[Callable[[SweepProgress], None]]:
    """Yield what shows the progress."""
    if quiet:
        yield lambda _progress: None
        return
    with closing(open_screen(sys.stdout)) as screen:
        yield lambda progress: screen.show(_reached(progress))


def _reached(progress: SweepProgress) -> Reached:
    failed = f", {progress.failed} failed" if progress.failed else ""
    what = "" if progress.phase == RUNNING else f"; {progress.phase}"
    return Reached(
        title="sweep",
        what=f"{progress.done} of {progress.total} runs{failed}{what}",
        done=progress.done,
        total=progress.total,
        rate="" if progress.rate is None else _rate(progress.rate),
        left_s=progress.remaining_s if progress.done < progress.total else None,
    )


def _rate(rate: float) -> str:
    return f"{rate:.1f} runs/s" if rate >= 1 else f"{1 / rate:.1f} s/run"


def _summary(result: SweepResult) -> Iterator[str]:
    made = result.done - result.resumed
    before = f", {result.resumed} resumed" if result.resumed else ""
    yield f"{made} runs in {result.wall_s:.1f} s{before}; {result.failed} of {result.total} failed"
    yield from (f"  {count} {cause}" for cause, count in result.causes.items())
    if result.metric_errors:
        yield f"{result.metric_errors} runs lack a metric; see the column metric_error"
    if (best := result.best) is not None:
        values = ", ".join(f"{path}={yaml_text(value)}" for path, value in best.values.items())
        yield f"best   run {best.run}: {result.metric} {best.metrics[str(result.metric)]}, {values}"
    yield f"table  {result.folder / TABLE_FILE}"
    yield f"page   {result.page}"
