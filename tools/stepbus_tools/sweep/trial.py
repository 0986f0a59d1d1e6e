"""One run of a sweep, in the process of a worker."""

import contextlib
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import ExitCode, RecordingFailed, RunFailure
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.inprocess.local_run import check_scenario
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import make_folder
from stepbus_schemas import StepbusError, WiringError
from stepbus_tools.report import write_report
from stepbus_tools.sweep.axes import FAULTS
from stepbus_tools.sweep.content import Content
from stepbus_tools.sweep.design import Point
from stepbus_tools.sweep.sweep_metrics import Metrics, Value, builtin_metrics

KEEP = ("all", "failed", "none")
NO_FAULT = "none"
REPORT_FILE = "report.png"


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """What a sweep knows of one run.

    reason: how it ended, without what only the machine knows. metrics: name → value.
    metric_error: why the user's metrics have none. wall_s, where, attempts: of this time only.
    """

    run: int
    values: dict[str, Any]
    outcome: str
    exit_code: int
    reason: str = ""
    participant: str | None = None
    steps: int = 0
    sha256: str = ""
    kept: bool = False
    metrics: dict[str, Value] = {}
    metric_error: str = ""
    wall_s: float = 0.0
    where: str = ""
    attempts: int = 1


class Trials:
    """Runs points of one sweep, one after the other, in a folder of its own.

    keep: which runs' folders stay. home: the sweep's folder, where it is within reach; else what
    stays is returned by content. temporary: where the folder is; None: where temporary ones are.
    """

    def __init__(
        self, content: Content, *, keep: str, home: Path | None, temporary: str | None = None
    ) -> None:
        self._content = content
        self._keep = keep
        self._home = home
        self._folder = Path(tempfile.mkdtemp(prefix="stepbus-sweep-", dir=temporary))
        self._scenario = content.unpack(self._folder / "source")
        self._metrics = Metrics(content.metrics, Content.metrics_folder(self._folder / "source"))

    def close(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def run(self, point: Point) -> tuple[Row, Mapping[str, bytes]]:
        """Run a point; return its row, and the files of a run that stays where none is in reach."""
        out, began = self._folder / "run", time.monotonic()
        try:
            scenario = self.load(point)
            row = self._row(point, self._run(scenario, out))
            row = msgspec.structs.replace(row, wall_s=time.monotonic() - began)
            return self._kept(row, out)
        except (RunFailure, StepbusError) as exc:
            code = exc.code if isinstance(exc, RunFailure) else ExitCode.SCENARIO
            return failed_row(point, "failed", str(exc), code), {}
        finally:
            shutil.rmtree(out, ignore_errors=True)

    def picture(self, point: Point) -> bytes:
        """Run a point once more, and return the plots of its report as PNG; empty: it has none."""
        out = self._folder / "picture"
        try:
            result = self._run(self.load(point), out)
            if result.steps and result.recording.exists():
                write_report(result.recording)
            return (out / REPORT_FILE).read_bytes() if (out / REPORT_FILE).exists() else b""
        finally:
            shutil.rmtree(out, ignore_errors=True)

    def load(self, point: Point) -> Scenario:
        """Return the scenario of a point; raises ScenarioError for one that cannot run."""
        texts, faults = overrides_of(point)
        return load(self._scenario, [*self._content.settings, *texts], faults)

    def _run(self, scenario: Scenario, out: Path) -> Result:
        in_process = can_share(scenario)
        options = Options(out=out, host=host_of(in_process=in_process, owns_descriptors=in_process))
        return run(scenario, options)

    def _row(self, point: Point, result: Result) -> Row:
        metrics: dict[str, Value] = {"success": result.exit_code == 0}
        error = ""
        if result.steps and result.recording.exists():
            metrics, error = self._measured(result)
        return Row(
            run=point.number,
            values=dict(point.values),
            outcome=result.outcome,
            exit_code=result.exit_code,
            reason=result.cause,
            participant=result.participant,
            steps=result.steps,
            sha256=result.sha256,
            metrics=metrics,
            metric_error=error,
        )

    def _measured(self, result: Result) -> tuple[dict[str, Value], str]:
        recording = Recording(result.recording)
        own, error = self._metrics.of(recording)
        return {**builtin_metrics(result, recording), **own}, error

    def _kept(self, row: Row, out: Path) -> tuple[Row, Mapping[str, bytes]]:
        is_kept = self._keep == "all" or (self._keep == "failed" and row.exit_code != 0)
        if not is_kept or not out.exists():
            return row, {}
        row = msgspec.structs.replace(row, kept=True)
        if self._home is None:
            return row, {str(p.relative_to(out)): p.read_bytes() for p in _files_below(out)}
        move_run(out, self._home, row.run)
        return row, {}


def can_share(scenario: Scenario) -> bool:
    """Return whether all participants can run in one process."""
    try:
        check_scenario(scenario)
    except WiringError:
        return False
    return True


def overrides_of(point: Point) -> tuple[list[str], Sequence[str]]:
    """Return the settings of a point, as `--set` has them, and its faults."""
    texts = [
        f"{path}={msgspec.json.encode(value).decode()}"
        for path, value in point.values.items()
        if path != FAULTS
    ]
    fault = point.values.get(FAULTS)
    given = fault if isinstance(fault, list) else [fault]
    return texts, [str(one) for one in given if one not in {None, NO_FAULT}]


def failed_row(point: Point, outcome: str, reason: str, code: int) -> Row:
    """Return the row of a run that has no result of its own."""
    return Row(
        run=point.number,
        values=dict(point.values),
        outcome=outcome,
        exit_code=code,
        reason=reason,
        metrics={"success": False},
    )


def run_folder(home: Path, number: int) -> Path:
    """Return the folder of a run that stays, in that of its sweep."""
    return home / "runs" / f"{number:06}"


def move_run(out: Path, home: Path, number: int) -> None:
    """Move the folder of a run to that of its sweep; nobody sees half of it.

    Raises RecordingFailed where it cannot be written.
    """
    target = run_folder(home, number)
    part = target.with_name(f".{target.name}.part")
    try:
        make_folder(target.parent)
        for old in (part, target):
            shutil.rmtree(old, ignore_errors=True)
        shutil.move(out, part)
        part.rename(target)
    except OSError as exc:
        with contextlib.suppress(OSError):
            shutil.rmtree(part)
        # Of a folder, shutil has a list of what it could not copy, each with its reason.
        why = exc.args[0][0][-1] if isinstance(exc, shutil.Error) else exc.strerror
        raise RecordingFailed(f"{target} cannot be written: {why or exc}") from exc


def write_run(files: Mapping[str, bytes], home: Path, number: int) -> None:
    """Write the files of a run that came from another machine; raises as `move_run`."""
    try:
        with tempfile.TemporaryDirectory(dir=home, prefix=".fetched-") as folder:
            out = Path(folder) / "run"
            for name, content in files.items():
                path = out / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            move_run(out, home, number)
    except RecordingFailed:
        raise
    except OSError as exc:
        target = run_folder(home, number)
        raise RecordingFailed(f"{target} cannot be written: {exc.strerror or exc}") from exc


def _files_below(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.rglob("*")) if path.is_file()]
