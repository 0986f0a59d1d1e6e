"""Runs a sweep: every point that has no row yet."""

import contextlib
import fcntl
import os
import shutil
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import ExitCode, Interrupted, OutputExists, RecordingFailed
from stepbus_orchestrator.processes.launcher import check_limits
from stepbus_participant import append_to, make_folder, need
from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import SOURCE_FOLDER, Bundle, collect
from stepbus_tools.sweep.optimize import Optimizer
from stepbus_tools.sweep.pool import PoolOptions, open_workers, run_points
from stepbus_tools.sweep.rows import TABLE_FILE, Journal, ResultRow, write_table
from stepbus_tools.sweep.spec import SPEC_FILE, Plan, differences, load_spec, save_spec
from stepbus_tools.sweep.sweep_page import PAGE_FILE, extremes, write_page
from stepbus_tools.sweep.trial import write_run

_TABLE_EVERY_S = 30.0
_LOCK = ".lock"
RUNNING = "runs"


@dataclass(frozen=True, kw_only=True)
class SweepProgress:
    """Progress of a sweep: finished, total and failed runs; rate of all workers [runs/s].

    rate: None until a run has finished. phase: current activity.
    """

    done: int
    total: int
    failed: int
    rate: float | None = None
    phase: str = RUNNING

    @property
    def remaining_s(self) -> float | None:
        """Return the remaining time [s]; None if not yet known."""
        return None if self.rate is None else (self.total - self.done) / self.rate


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """Result of a sweep.

    resumed: earlier runs. causes: cause → number of failed runs. best: row with the best metric of
    a search, with an optimizer; metric: its name.
    """

    folder: Path
    total: int
    done: int
    resumed: int
    failed: int
    metric_errors: int
    causes: Mapping[str, int]
    wall_s: float
    best: ResultRow | None = None
    metric: str | None = None

    def table(self) -> Any:
        """Return all rows, as a `pyarrow.Table`."""
        (parquet,) = need("a sweep", "pyarrow.parquet")
        return parquet.read_table(self.folder / TABLE_FILE)

    @property
    def page(self) -> Path:
        """Return the path of report.html."""
        return self.folder / PAGE_FILE


def sweep(
    plan: Plan,
    options: PoolOptions,
    on_progress: Callable[[SweepProgress], None] = lambda _progress: None,
    interrupt: threading.Event | None = None,
) -> SweepResult:
    """Run the missing points of a sweep, and write its tables.

    interrupt: ends it once it is set; what is done stays, and the same call goes on from there.

    Raises RecordingFailed where its folder holds another sweep or cannot be written, StartFailed
    where the workers do not start, and Interrupted.
    """
    bundle = collect(plan.variants, plan.spec.metrics)
    check_limits(len(plan.variants[0].participants))
    with _claimed(options.home):
        _claim(plan, bundle, options.home)
        with Journal(options.home) as journal:
            return _Sweep(plan, bundle, options, journal, on_progress).run(
                interrupt or threading.Event()
            )


@contextlib.contextmanager
def _claimed(home: Path) -> Iterator[None]:
    """Hold a sweep's folder; raises RecordingFailed where another process does."""
    try:
        make_folder(home)
        lock = os.fdopen(append_to(home / _LOCK), "ab")
    except OSError as exc:
        raise RecordingFailed(f"cannot create folder {home}: {exc.strerror}") from exc
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as exc:
            raise RecordingFailed(f"{home}: another process runs this sweep") from exc
        yield


def _claim(plan: Plan, bundle: Bundle, home: Path) -> None:
    """Claim a folder for this sweep; raises OutputExists where it holds another sweep."""
    fingerprint = bundle.fingerprint()
    if not (home / SPEC_FILE).exists():
        shutil.rmtree(home / SOURCE_FOLDER, ignore_errors=True)
        bundle.unpack(home / SOURCE_FOLDER)
        save_spec(home, plan.spec, fingerprint)
        return
    old, before = load_spec(home)
    changes = differences(old, plan.spec)
    if not changes and before != fingerprint:
        changes = ["a file of the scenario or a metric has changed"]
    if changes:
        raise OutputExists(
            f"{home} contains another sweep: {'; '.join(changes)}; give another --out"
        )


class _Sweep:
    """One execution."""

    def __init__(
        self,
        plan: Plan,
        bundle: Bundle,
        options: PoolOptions,
        journal: Journal,
        on_progress: Callable[[SweepProgress], None],
    ) -> None:
        self._plan = plan
        self._optimizer = None if plan.spec.optimize is None else Optimizer(plan)
        self._options, self._home = options, options.home
        self._bundle = bundle
        self._journal = journal
        self._on_progress = on_progress
        self._total = len(self._optimizer or plan.design)
        self._paths = (self._optimizer or plan.design).paths
        self._resumed = len(journal)
        self._causes: Counter[str] = Counter()
        self._metric_errors = 0
        self._began = self._tabled = time.monotonic()

    def run(self, interrupt: threading.Event) -> SweepResult:
        """Run all points without a row, and write the tables and the page; raises Interrupted."""
        journal = self._journal
        for row in journal.values():
            self._count(row)
        if self._resumed < self._total:
            self._report("starting workers")
            with open_workers(self._bundle, self._options, interrupt) as self._workers:
                self._began_runs = time.monotonic()
                self._run_missing(interrupt)
                write_table(journal, self._paths, self._home)
                if not interrupt.is_set() and (wanted := dict(self._pictures().values())):
                    self._report(
                        "plotting the " + " and the ".join(p.stem for p in wanted.values()) + " run"
                    )
                    self._workers.plot(wanted, interrupt)
        write_table(journal, self._paths, self._home)
        pictures = {name: path for name, (_, path) in self._pictures().items() if path.exists()}
        write_page(journal, self._plan, self._paths, self._home, pictures)
        if interrupt.is_set():
            raise Interrupted(
                f"interrupted after {len(journal)} of {self._total} runs; run the same "
                "command again to resume"
            )
        return SweepResult(
            folder=self._home,
            total=self._total,
            done=len(journal),
            resumed=self._resumed,
            failed=self._causes.total(),
            metric_errors=self._metric_errors,
            causes=dict(sorted(self._causes.items())),
            wall_s=time.monotonic() - self._began,
            best=extremes(journal, self._plan.spec).get("best") if self._optimizer else None,
            metric=self._plan.spec.optimize,
        )

    def _run_missing(self, interrupt: threading.Event) -> None:
        optimizer = self._optimizer
        batches = [self._plan.design] if optimizer is None else optimizer.batches()
        for batch in batches:
            missing = (point for point in batch if point.number not in self._journal)
            self._run_points(missing, interrupt)
            if interrupt.is_set():
                return
            if optimizer is not None:
                optimizer.tell([_checked(self._journal[p.number], p) for p in batch])

    def _pictures(self) -> dict[str, tuple[int, Path]]:
        """Return title → number and picture of the best and the worst run."""
        return {
            f"{name} run: {row.run}": (row.run, self._home / f"{name}.png")
            for name, row in extremes(self._journal, self._plan.spec).items()
        }

    def _run_points(self, points: Iterable[Point], interrupt: threading.Event) -> None:
        journal = self._journal
        for row, files in run_points(self._workers, self._options, points, interrupt.is_set):
            if row.exit_code == ExitCode.RECORDING:
                # The machine's fault, not the point's: a row of it would stay for good.
                raise RecordingFailed(
                    f"run {row.run} was not recorded: {row.reason}; the {len(journal)} finished "
                    "runs are kept; run the same command again to resume"
                )
            if files:
                write_run(files, self._home, row)
            journal.add(row)
            self._count(row)
            self._report()
            if time.monotonic() - self._tabled > _TABLE_EVERY_S:
                write_table(journal, self._paths, self._home)
                self._tabled = time.monotonic()

    def _count(self, row: ResultRow) -> None:
        if row.exit_code:
            who = f" ({row.participant})" if row.participant else ""
            self._causes[f"{row.outcome}{who}, exit code {row.exit_code}"] += 1
        self._metric_errors += bool(row.metric_error)

    def _report(self, phase: str = RUNNING) -> None:
        """Notify the observer of the progress and the current phase."""
        made = len(self._journal) - self._resumed if phase == RUNNING else 0
        self._on_progress(
            SweepProgress(
                done=len(self._journal),
                total=self._total,
                failed=self._causes.total(),
                rate=made / (time.monotonic() - self._began_runs) if made else None,
                phase=phase,
            )
        )


def _checked(row: ResultRow, point: Point) -> ResultRow:
    """Return the row of a point; raises WiringError where it is another point's.

    The optimizer would not have asked for it: another version of Optuna chooses otherwise.
    """
    if row.values != dict(point.values):
        raise WiringError(
            f"run {row.run} used different values from those the optimizer now proposes; resume "
            "with the versions of Optuna and SciPy that started the sweep"
        )
    return row
