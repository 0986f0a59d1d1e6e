"""Points as tasks of workers: on this machine, or of a Ray cluster.

A point whose process dies is run again; nothing else is lost.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import msgspec

from stepbus_orchestrator.errors import ExitCode, Interrupted, StartFailed
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import Bundle
from stepbus_tools.sweep.rows import ResultRow, failed_row
from stepbus_tools.sweep.trial import Files

WAIT_S = 0.25
_MOST_DEATHS = 3
_RETRIED = frozenset(
    (ExitCode.START, ExitCode.DIED, ExitCode.STEP_TIMEOUT, ExitCode.BUS, ExitCode.STOP_TIMEOUT)
)
"""Failures that a machine can cause; any other would come again."""
Done = tuple[ResultRow, Files]
"""The row of a run, and its files where it stays and comes from a cluster."""
Answer = tuple[bytes, Files, str]
"""The same from a process, the row as JSON: empty where it died, and where there is an error."""


@dataclass(frozen=True, kw_only=True)
class PoolOptions:
    """How a pool runs points.

    jobs: processes at once; 0: as many as there are cores. keep: which runs stay. home: the
    sweep's folder. timeout_s: of a run; 0: none. retries: of a run that a machine may have failed.
    address: of a Ray cluster; empty: this machine only.
    """

    home: Path
    jobs: int = 0
    keep: str = "failed"
    timeout_s: float = 0.0
    retries: int = 0
    address: str = ""


class Workers(Protocol):
    """Processes that run points."""

    def cores(self) -> int:
        """Return how many points may run at once."""

    def start(self, point: Point) -> Any:
        """Start the run of a point; return its key."""

    def answers(self, keys: Sequence[Any], timeout_s: float) -> Iterator[tuple[Any, Answer]]:
        """Yield the answers that have come for `keys`, after waiting at most `timeout_s` [s]."""

    def plot(self, pictures: Mapping[int, Path], interrupt: threading.Event) -> None:
        """Make runs again, and plot them; pictures: number of the run → its picture."""


def open_workers(
    bundle: Bundle, options: PoolOptions, interrupt: threading.Event
) -> AbstractContextManager[Workers]:
    """Start workers; those that have started end with the context.

    Raises StartFailed where they do not start or a metric cannot be loaded, ExtraMissing where
    there is an address and Ray is not installed, Interrupted where that is set meanwhile.
    """
    options = replace(options, home=options.home.resolve())
    if options.address:
        from stepbus_tools.sweep.ray_workers import RayWorkers  # noqa: PLC0415  (an extra)

        return RayWorkers(bundle, options, interrupt)
    from stepbus_tools.sweep.local_workers import LocalWorkers  # noqa: PLC0415  (imports this)

    return LocalWorkers(bundle, options, interrupt)


def wait_for_start(
    is_ready: Callable[[float], bool], limit_s: float, interrupt: threading.Event
) -> None:
    """Wait until workers have started; is_ready: waits for so long itself [s].

    Raises StartFailed after `limit_s`, and Interrupted.
    """
    end = time.monotonic() + limit_s
    while not is_ready(WAIT_S):
        if interrupt.is_set():
            raise Interrupted("interrupted before the first run; run the same command again")
        if time.monotonic() > end:
            raise StartFailed(
                f"no worker has started within {limit_s:.0f} s; is a core free, and does a metric "
                "wait for something when it is imported?"
            )


@dataclass
class _Task:
    point: Point
    attempts: int = 0
    deaths: int = 0
    since: float = field(default_factory=time.monotonic)


def run_points(
    workers: Workers, options: PoolOptions, points: Iterable[Point], is_over: Callable[[], bool]
) -> Iterator[Done]:
    """Yield row and files of each point, as they come; until all have, or it is over."""
    tasks, pending = map(_Task, points), dict[Any, _Task]()

    def start(task: _Task) -> None:
        task.attempts += 1
        task.since = time.monotonic()
        pending[workers.start(task.point)] = task

    while not is_over():
        for task in islice(tasks, max(0, workers.cores() - len(pending))):
            start(task)
        if not pending:
            return
        for key, answer in workers.answers(list(pending), WAIT_S):
            task = pending.pop(key)
            done = _done(task, answer, options)
            if done is None:
                start(task)
            else:
                yield msgspec.structs.replace(done[0], attempts=task.attempts), done[1]


def _done(task: _Task, answer: Answer, options: PoolOptions) -> Done | None:
    """Return what became of a task; None if it has to run again."""
    data, files, error = answer
    if error:
        return failed_row(task.point, "failed", error, ExitCode.INTERNAL), {}
    if not data:
        limit_s = options.timeout_s
        if limit_s and time.monotonic() - task.since >= limit_s:
            reason = f"it exceeded the limit of {limit_s:g} s"
            return failed_row(task.point, "timed out", reason, ExitCode.STEP_TIMEOUT), {}
        task.deaths += 1
        if task.deaths < _MOST_DEATHS:
            return None
        reason = f"its worker process died {task.deaths} times"
        return failed_row(task.point, "died", reason, ExitCode.DIED), {}
    row = msgspec.json.decode(data, type=ResultRow)
    if row.exit_code in _RETRIED and task.attempts <= options.retries:
        return None
    return row, files
