"""Runs a sweep: every point that has no row yet."""

import fcntl
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import (
    ExitCode,
    Interrupted,
    OutputExists,
    RecordingFailed,
    argument,
)
from stepbus_orchestrator.processes.limits import check_limits
from stepbus_participant import append_to, make_folder, need
from stepbus_schemas import WiringError
from stepbus_tools.sweep.content import Content, collect
from stepbus_tools.sweep.design import Point
from stepbus_tools.sweep.journal import Journal
from stepbus_tools.sweep.pool import Pool, Terms
from stepbus_tools.sweep.result_table import TABLE_FILE, write_table
from stepbus_tools.sweep.sweep_page import PAGE_FILE, extremes, write_page
from stepbus_tools.sweep.trial import Row, write_run
from stepbus_tools.whole_file import replaced

from .optimize import Optimizer
from .spec import SPEC_FILE, Spec, differences, load_spec, save_spec
from .spec_check import Checked, check

SOURCE_FOLDER = "source"
_TABLE_EVERY_S = 30.0
_LOCK = ".lock"
RUNNING = "runs"


@dataclass(frozen=True, kw_only=True)
class SweepProgress:
    """How far a sweep is: rows of all, of which failed; rate of all workers [runs/s].

    rate: None until a worker has done its second run. phase: what happens now.
    """

    done: int
    total: int
    failed: int
    rate: float | None = None
    phase: str = RUNNING

    @property
    def remaining_s(self) -> float | None:
        """Return how long the rest takes [s]; None: not yet known."""
        return None if self.rate is None else (self.total - self.done) / self.rate


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """What became of a sweep. resumed: rows that were there before. causes: outcome → runs."""

    folder: Path
    total: int
    done: int
    resumed: int
    failed: int
    metric_errors: int
    causes: Mapping[str, int]
    wall_s: float

    def table(self) -> Any:
        """Return all rows, as a `pyarrow.Table`."""
        (parquet,) = need("a sweep", "pyarrow.parquet")
        return parquet.read_table(self.folder / TABLE_FILE)

    @property
    def page(self) -> Path:
        """Return the path of report.html."""
        return self.folder / PAGE_FILE


def sweep(
    spec: Spec,
    terms: Terms,
    on_progress: Callable[[SweepProgress], None] = lambda _progress: None,
    interrupt: threading.Event | None = None,
) -> SweepResult:
    """Run what is missing of a sweep, and write its tables.

    interrupt: ends it once it is set; what is done stays, and the same call goes on from there.

    Raises ScenarioError or WiringError with every problem of the sweep, RecordingFailed where its
    folder holds another one or cannot be written, StartFailed where Ray does not start, and
    Interrupted.
    """
    checked = check(spec)
    content = collect(checked.variants, spec.metrics)
    check_limits(len(checked.scenario.participants))
    with _claimed(terms.home):
        _claim(spec, content, terms.home)
        return _Sweep(spec, checked, content, terms, on_progress).run(
            interrupt or threading.Event()
        )


@contextmanager
def _claimed(home: Path) -> Iterator[None]:
    """Hold a sweep's folder; raises RecordingFailed where another process does."""
    try:
        make_folder(home)
        lock = os.fdopen(append_to(home / _LOCK), "ab")
    except OSError as exc:
        raise RecordingFailed(f"cannot make the folder {home}: {exc.strerror}") from exc
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as exc:
            raise RecordingFailed(f"{home}: another process runs this sweep") from exc
        yield


def _claim(spec: Spec, content: Content, home: Path) -> None:
    """Make a folder this sweep's; raises RecordingFailed where it is another one's."""
    fingerprint = content.fingerprint()
    if not (home / SPEC_FILE).exists():
        shutil.rmtree(home / SOURCE_FOLDER, ignore_errors=True)
        content.unpack(home / SOURCE_FOLDER)
        save_spec(home, spec, fingerprint)
        return
    old, before = load_spec(home)
    changes = differences(old, spec)
    if not changes and before != fingerprint:
        changes = ["a file of the scenario, or a metric, has changed"]
    if changes:
        raise OutputExists(
            f"{home} holds another sweep: {'; '.join(changes)}; give another {argument('--out')}"
        )


class _Sweep:
    """One execution."""

    def __init__(
        self,
        spec: Spec,
        checked: Checked,
        content: Content,
        terms: Terms,
        on_progress: Callable[[SweepProgress], None],
    ) -> None:
        self._spec = spec
        self._design = checked.design
        self._optimizer = None if spec.optimize is None else Optimizer(spec)
        self._terms = terms
        self._content = content
        # An optimizer asks for a batch, and waits for all of it.
        self._at_once = None if self._optimizer is None else spec.batch
        self._on_progress = on_progress
        self._total = len(self._optimizer or self._design)
        self._paths: Sequence[str] = (self._optimizer or self._design).paths
        self._causes: dict[str, int] = {}
        self._metric_errors = 0
        self._began = time.monotonic()
        self._tabled = self._began

    def run(self, interrupt: threading.Event) -> SweepResult:
        with Journal(self._terms.home) as journal:
            resumed = len(journal)
            for row in journal.rows():
                self._count(row)
            if resumed < self._total:
                self._run_missing(journal, interrupt)
            self._conclude(journal)
            if interrupt.is_set():
                raise Interrupted(
                    f"interrupted after {len(journal)} of {self._total} runs; the same command "
                    "goes on from there"
                )
            return self._result(len(journal), resumed)

    def _run_missing(self, journal: Journal, interrupt: threading.Event) -> None:
        self._tell(journal, "Ray starts, which takes some seconds, on a busy machine a minute")
        with Pool(self._content, self._terms) as self._pool:
            self._tell(journal, "the workers start")
            if self._optimizer is None:
                missing = (p for p in self._design if p.number not in journal)
                self._run_points(missing, journal, interrupt)
                self._draw_extremes(journal, interrupt)
                return
            for batch in self._optimizer.batches():
                missing = (p for p in batch if p.number not in journal)
                self._run_points(missing, journal, interrupt)
                if interrupt.is_set():
                    return
                rows = [_checked(journal.row(p.number), p) for p in batch]
                self._optimizer.refuse_unmeasured(rows)
                self._optimizer.tell(rows)
            self._draw_extremes(journal, interrupt)

    def _draw_extremes(self, journal: Journal, interrupt: threading.Event) -> None:
        """Plot the best and the worst run; both are made again, since they may not have stayed."""
        chosen = extremes(journal, self._spec)
        if interrupt.is_set() or not chosen:
            return
        self._tell(journal, f"the plots of the {' and the '.join(chosen)} run are made")
        points = [Point(row.run, row.values) for row in chosen.values()]
        for name, content in zip(chosen, self._pool.pictures(points), strict=True):
            if content:
                with replaced(self._terms.home / f"{name}.png") as part:
                    part.write_bytes(content)

    def _conclude(self, journal: Journal) -> None:
        """Write the tables and the page."""
        write_table(journal, self._paths, self._terms.home)
        pictures = {
            f"{name} run: {row.run}": path
            for name, row in extremes(journal, self._spec).items()
            if (path := self._terms.home / f"{name}.png").exists()
        }
        write_page(journal, self._spec, self._paths, self._terms.home, pictures)

    def _run_points(
        self, points: Iterator[Point], journal: Journal, interrupt: threading.Event
    ) -> None:
        for row, files in self._pool.run(points, interrupt.is_set):
            if row.exit_code == ExitCode.RECORDING:
                # The machine's fault, not the point's: a row of it would stay for good.
                raise RecordingFailed(
                    f"run {row.run}: {row.reason}; its row is left out, all {len(journal)} others "
                    "are there, and the same command goes on from them"
                )
            if files:
                write_run(files, self._terms.home, row.run)
            journal.add(row)
            self._count(row)
            self._tell(journal)
            if time.monotonic() - self._tabled > _TABLE_EVERY_S:
                write_table(journal, self._paths, self._terms.home)
                self._tabled = time.monotonic()

    def _count(self, row: Row) -> None:
        if row.exit_code:
            self._causes[_cause(row)] = self._causes.get(_cause(row), 0) + 1
        self._metric_errors += bool(row.metric_error)

    def _tell(self, journal: Journal, phase: str = RUNNING) -> None:
        """Say how far the sweep is, and what happens now."""
        self._on_progress(
            SweepProgress(
                done=len(journal),
                total=self._total,
                failed=sum(self._causes.values()),
                rate=self._pool.rate(self._at_once) if phase == RUNNING else None,
                phase=phase,
            )
        )

    def _result(self, done: int, resumed: int) -> SweepResult:
        return SweepResult(
            folder=self._terms.home,
            total=self._total,
            done=done,
            resumed=resumed,
            failed=sum(self._causes.values()),
            metric_errors=self._metric_errors,
            causes=dict(sorted(self._causes.items())),
            wall_s=time.monotonic() - self._began,
        )


def _cause(row: Row) -> str:
    who = f" ({row.participant})" if row.participant else ""
    return f"{row.outcome}{who}, exit code {row.exit_code}"


def _checked(row: Row, point: Point) -> Row:
    """Return the row of a point; raises WiringError where it is another point's.

    The optimizer would not have asked for it: another version of Optuna chooses otherwise.
    """
    if row.values != dict(point.values):
        raise WiringError(
            f"run {row.run} was made with other values than the optimizer asks for now: resume "
            "with the versions of Optuna and SciPy that began the sweep"
        )
    return row
