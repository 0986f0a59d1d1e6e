"""A run of a sweep, which can be made again from the files that the sweep's folder keeps."""

import contextlib
import os
import shutil
import threading
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.recording.layout import SCENARIO_ATTACHMENT, file_attachment
from stepbus_orchestrator.run.folder import read_files, scratch_folder
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.override import override
from stepbus_participant.parameters import read_yaml
from stepbus_schemas import StepbusError, WiringError
from stepbus_tools.report.picture import REPORT_FILE
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import SOURCE_FOLDER
from stepbus_tools.sweep.rows import Journal, ResultRow
from stepbus_tools.sweep.spec import SPEC_FILE, load_spec, overrides_of
from stepbus_tools.sweep.trial import quick_host
from stepbus_tools.viewing.page import RunPage
from stepbus_tools.whole_file import replaced


@dataclass(frozen=True, kw_only=True)
class RowRerun:
    """A run of a sweep, and the same made again."""

    row: ResultRow
    result: Result

    @property
    def equal(self) -> bool:
        """Return whether both recordings are the same, byte for byte."""
        return bool(self.row.sha256) and self.row.sha256 == self.result.sha256


class RowRun:
    """Run `number` of a sweep's folder, which starts nothing before `run`.

    path: of the sweep's file. Raises WiringError where the folder holds no sweep or no such run.
    """

    def __init__(self, folder: Path, number: int) -> None:
        load_spec(folder)
        with Journal(folder) as journal:
            if number not in journal:
                raise WiringError(f"{folder} has no run {number}; it has {len(journal)} runs")
            self._row = journal[number]
        self.path = folder / SPEC_FILE
        self._source = folder / SOURCE_FOLDER / "scenario"
        files = self._source.rglob(SCENARIO_ATTACHMENT)
        file = min(files, key=lambda p: (-len(p.parts), p), default=None)
        if file is None:
            raise WiringError(f"{self._source}: the scenario of the sweep no longer exists")
        self._file = file
        self._settings, self._faults = overrides_of(Point(number, self._row.values))

    @cached_property
    def scenario(self) -> dict[str, Any]:
        """Return the scenario with the values of this run."""
        document = read_yaml(self._file, "a scenario")
        return override(document, self._settings, self._file.parent)[0].data

    @cached_property
    def attachments(self) -> dict[str, bytes]:
        """Return the scenario and its files, as the recording of this run attaches them."""
        home = self._file.parent
        files = {
            file_attachment(Path(os.path.relpath(path, home)).as_posix()): path
            for path in self._source.rglob("*")
            if path.is_file() and path != self._file
        }
        return {SCENARIO_ATTACHMENT: msgspec.json.encode(self.scenario), **read_files(files)}

    def run(
        self,
        out: Path,
        observer: Observer | None = None,
        interrupt: threading.Event | None = None,
        *,
        is_quick: bool = False,
    ) -> RowRerun:
        """Run it again; out: a new folder. Raises as `stepbus run` does.

        is_quick: in this process, which is the run's alone, where the scenario allows it; else in
        separate ones.
        """
        scenario = load(self._file, self._settings, self._faults)
        options = Options(out=out, host=quick_host(scenario)) if is_quick else Options(out=out)
        return RowRerun(row=self._row, result=run(scenario, options, observer, interrupt))


def plot_run(folder: Path, number: int, picture: Path, interrupt: threading.Event | None) -> None:
    """Make a run of a sweep again, and plot it; one that fails leaves no picture.

    interrupt: None in a process that is the run's alone.
    """
    with contextlib.suppress(StepbusError), scratch_folder("sweep") as out:
        made = RowRun(folder, number).run(
            out / "run", interrupt=interrupt, is_quick=interrupt is None
        )
        list(RunPage(made.result.recording).draw())
        with replaced(picture) as part:
            shutil.copyfile(out / "run" / REPORT_FILE, part)
