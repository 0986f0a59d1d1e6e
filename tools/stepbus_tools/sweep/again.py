"""Does one run of a sweep again, in separate processes."""

import threading
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import WiringError
from stepbus_tools.sweep.design import Point
from stepbus_tools.sweep.journal import Journal
from stepbus_tools.sweep.trial import Row, overrides_of

from .run_sweep import SOURCE_FOLDER
from .spec import load_spec


@dataclass(frozen=True, kw_only=True)
class Again:
    """A run of a sweep, and the same made again."""

    row: Row
    result: Result

    @property
    def equal(self) -> bool:
        """Return whether both recordings are the same, byte for byte."""
        return bool(self.row.sha256) and self.row.sha256 == self.result.sha256


def rerun_row(
    folder: Path,
    number: int,
    out: Path,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Again:
    """Run a row of a sweep's folder again, from the files that the sweep keeps.

    out: a new folder. Raises WiringError where the folder holds no sweep or no such row, and as
    `stepbus run` does.
    """
    load_spec(folder)
    row = _row(folder, number)
    texts, faults = overrides_of(Point(number, row.values))
    source = folder / SOURCE_FOLDER / "scenario"
    match = next(
        iter(sorted(source.rglob(layout.SCENARIO_ATTACHMENT), key=lambda p: -len(p.parts))), None
    )
    if match is None:
        raise WiringError(f"{source}: the sweep's scenario is gone")
    scenario = load(match, texts, faults)
    return Again(row=row, result=run(scenario, Options(out=out), observer, interrupt))


def _row(folder: Path, number: int) -> Row:
    with Journal(folder) as journal:
        if number not in journal:
            raise WiringError(f"{folder} has no run {number}; it has {len(journal)} runs")
        return journal.row(number)
