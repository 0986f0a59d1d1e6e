"""`stepbus sweep`: many runs of one scenario, and one table of them."""

from collections.abc import Iterator
from contextlib import ExitStack

from stepbus import sweep
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.terminal.live import Reached, displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.scenario.override import yaml_text
from stepbus_participant import parse_duration
from stepbus_tools.commands.declared import Sweep
from stepbus_tools.sweep.rows import TABLE_FILE
from stepbus_tools.sweep.run_sweep import RUNNING, SweepProgress, SweepResult
from stepbus_tools.sweep.server_process import end_early


def sweep_command(given: Sweep) -> Answer:
    """Make the runs that are missing, and return their table."""
    options = vars(given).copy()
    is_json, timeout, jobs = (options.pop(name) for name in ("json", "timeout", "jobs"))
    options |= {"jobs": jobs or 0, "timeout_s": parse_duration(timeout) * 1e-9 if timeout else 0.0}
    with (
        ExitStack() as stack,
        interruptible(ends=True) as interrupt,
        displayed("sweep", quiet=is_json) as display,
    ):
        stack.callback(end_early)
        if display is not None:
            options["on_progress"] = lambda progress: display.show(_reached(progress))
        result = sweep(**options, interrupt=interrupt)
    return Answer(value=result, lines=_summary(result))


def _reached(progress: SweepProgress) -> Reached:
    failed = f", {progress.failed} failed" if progress.failed else ""
    what = "" if progress.phase == RUNNING else f"; {progress.phase}"
    return Reached(
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
