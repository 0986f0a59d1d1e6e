"""One run of a sweep, in the process of a worker."""

import contextlib
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name

import msgspec

from stepbus_orchestrator.errors import ExitCode, RecordingFailed, RunFailure
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.layout import CHAIN_TYPE
from stepbus_orchestrator.run.extension import Host
from stepbus_orchestrator.run.inprocess.local_run import check_scenario
from stepbus_orchestrator.run.result import Result, own_versions
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import is_ours, make_folder
from stepbus_schemas import StepbusError, WiringError, json_schema
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import METRICS_FOLDER, SOURCE_FOLDER, Bundle
from stepbus_tools.sweep.rows import ResultRow, failed_row
from stepbus_tools.sweep.spec import overrides_of
from stepbus_tools.sweep.sweep_metrics import UserMetrics, Value, builtin_metrics

Files = Mapping[str, bytes]
"""Name → content of the files of a run."""


class Trials:
    """Runs points of one sweep, one after the other.

    folder: a new one, in which they take place. keep: which runs' folders stay. home: the sweep's
    folder, where it is within reach; else what stays is returned by content.
    """

    def __init__(self, bundle: Bundle, folder: Path, *, keep: str, home: Path | None) -> None:
        self._bundle = bundle
        self._keep = keep
        self._home = home
        self._folder = folder
        self._source = folder / SOURCE_FOLDER
        self._scenario = bundle.unpack(self._source)
        self._metrics: UserMetrics | None = None

    def prepare(self) -> None:
        """Load what each run needs, but no code of the user's."""
        scenario, types = load(self._scenario, self._bundle.settings), [CHAIN_TYPE]
        for spec in scenario.participants:
            types += [output.type for output in spec.outputs.values()]
            # A run that needs it says what is wrong.
            with contextlib.suppress(Exception):
                if is_ours(spec.participant):
                    resolve_name(spec.participant)
        for name in types:
            json_schema(name, scenario.types)
        own_versions()

    def load_metrics(self) -> UserMetrics:
        """Load the user's metrics, once; raises MetricFailed for one that cannot be loaded."""
        if self._metrics is None:
            self._metrics = UserMetrics(self._bundle.metrics, self._source / METRICS_FOLDER)
        return self._metrics

    def run(self, point: Point, timeout_s: float) -> tuple[bytes, Files]:
        """Run a point; return its row as JSON, and the files of a run that stays elsewhere.

        A run that takes longer than `timeout_s` ends the process: the kernel's timer does so even
        if the run hangs in C. 0: it may take any time.
        """
        signal.setitimer(signal.ITIMER_REAL, timeout_s)
        out, began = self._folder / f"run-{point.number}", time.monotonic()
        # Of a process that died in the midst of this run.
        shutil.rmtree(out, ignore_errors=True)
        try:
            row, files = self._kept(self._row(point, self._run(point, out)), out)
            row = msgspec.structs.replace(row, wall_s=time.monotonic() - began)
        except (RunFailure, StepbusError) as exc:
            code = exc.code if isinstance(exc, RunFailure) else ExitCode.SCENARIO
            row, files = failed_row(point, "failed", str(exc), code), {}
        finally:
            shutil.rmtree(out, ignore_errors=True)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        return msgspec.json.encode(msgspec.structs.replace(row, where=os.uname().nodename)), files

    def _run(self, point: Point, out: Path) -> Result:
        """Run a point; raises ScenarioError for one that cannot run."""
        texts, faults = overrides_of(point)
        scenario = load(self._scenario, [*self._bundle.settings, *texts], faults)
        return run(scenario, Options(out=out, host=quick_host(scenario)))

    def _row(self, point: Point, result: Result) -> ResultRow:
        metrics: dict[str, Value] = {"success": result.exit_code == 0}
        errors = list[str]()
        if result.steps and result.recording.exists():
            recording = Recording(result.recording)
            own, errors = self.load_metrics().of(recording)
            metrics = {**builtin_metrics(result, recording), **own}
        for name, value in metrics.items():
            if isinstance(value, int | float) and not abs(value) <= sys.float_info.max:
                # No number to compare, and JSON or a double has none.
                errors.append(f"{name} is {value}")
                metrics[name] = None
        return ResultRow(
            run=point.number,
            values=dict(point.values),
            outcome=result.outcome,
            exit_code=result.exit_code,
            reason=result.cause,
            participant=result.participant,
            steps=result.steps,
            sha256=result.sha256,
            metrics=metrics,
            metric_error="; ".join(errors),
        )

    def _kept(self, row: ResultRow, out: Path) -> tuple[ResultRow, Files]:
        is_kept = self._keep == "all" or (self._keep == "failed" and row.exit_code != 0)
        if not is_kept or not out.exists():
            return row, {}
        row = msgspec.structs.replace(row, kept=True)
        if self._home is not None:
            move_run(out, self._home, row)
            return row, {}
        paths = (path for path in sorted(out.rglob("*")) if path.is_file())
        return row, {str(path.relative_to(out)): path.read_bytes() for path in paths}


def quick_host(scenario: Scenario) -> Host:
    """Return the host of a run in a process of its own: this process, if it can run there."""
    try:
        check_scenario(scenario)
    except WiringError:
        return host_of(in_process=False)
    return host_of(in_process=True, owns_descriptors=True)


def move_run(out: Path, home: Path, row: ResultRow) -> None:
    """Move the folder of a run to that of its sweep; no reader sees half of it.

    Raises RecordingFailed where it cannot be written.
    """
    target = home / str(row.folder)
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


def write_run(files: Files, home: Path, row: ResultRow) -> None:
    """Write the files of a run that came from another machine; raises as `move_run`."""
    try:
        with tempfile.TemporaryDirectory(dir=home, prefix=".fetched-") as folder:
            out = Path(folder) / "run"
            for name, content in files.items():
                path = out / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            move_run(out, home, row)
    except RecordingFailed:
        raise
    except OSError as exc:
        target = home / str(row.folder)
        raise RecordingFailed(f"{target} cannot be written: {exc.strerror or exc}") from exc
