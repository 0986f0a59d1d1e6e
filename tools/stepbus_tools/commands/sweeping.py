"""Runs a sweep, and shows its progress and its table."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from stepbus import sweep
from stepbus_orchestrator.cli.signals import interruptible, settle
from stepbus_orchestrator.cli.terminal.live import shows_progress
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.cli.terminal.progress import Reached
from stepbus_orchestrator.scenario.override import yaml_text
from stepbus_tools.sweep.rows import TABLE_FILE
from stepbus_tools.sweep.run_sweep import RUNNING, SweepProgress, SweepResult


def sweep_command(scenario: str, *, json: bool, **given: Any) -> int:
    """Run a sweep, and show its progress and its table. given: as of `stepbus.sweep`."""
    with interruptible() as interrupt, _shown(quiet=json) as show:
        result = sweep(scenario, **given, on_progress=show, interrupt=interrupt)
        settle()
    return Answer(value=result, lines=_summary(result)).show(as_json=json)


@contextmanager
def _shown(*, quiet: bool) -> Iterator[Callable[[SweepProgress], None]]:
    """Yield what shows the progress."""
    if quiet:
        yield lambda _progress: None
        return
    _, show, clear = shows_progress(sys.stdout)
    try:
        yield lambda progress: show(_reached(progress))
    finally:
        clear()


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
