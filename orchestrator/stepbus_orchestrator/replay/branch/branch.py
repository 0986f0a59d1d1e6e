"""Branches a recording at a step: the function behind `stepbus branch`, free of printing."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.prefix import RecordedPrefix
from stepbus_orchestrator.run.reports.progress import Observer
from stepbus_orchestrator.run.reports.result import Result, file_sha256
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario import Scenario

from .plan import Change, Plan, plan


@dataclass(frozen=True, kw_only=True)
class Branch:
    """A run whose first steps are those of a recording.

    at: the first step that is not. changed: participants whose own outputs count from there on
    only. recorded_sha256: of the recording. way_s: how long the run took to get to `at` [s]; 0
    where it did not get there.
    """

    recording: Path
    at: int
    changed: Sequence[str]
    recorded_sha256: str
    way_s: float
    result: Result
    notes: Sequence[str] = field(default=())

    @property
    def equal(self) -> bool:
        """Return whether the new recording is the old one, byte for byte."""
        return self.recorded_sha256 == self.result.sha256


class BranchPlan:
    """A branch that is about to start; the recording's files are unpacked in `out/source`.

    at: the first live step, or its time, such as `6s`. overrides: settings such as
    `controller.params.kp=90`. faults: such as `kill plant at 1300`. calls: such as
    `controller set kp 90`, made before step `at`. trusted: fingerprint of the programs that may be
    started; None: any. scenario: what runs. notes: what may make it different from the recording.

    Raises RecordingFailed when the recording does not go so far, or `out` holds a run already;
    ScenarioError when the scenario cannot run here; WiringError for a change that no branch can
    make.
    """

    def __init__(
        self,
        recording: Path,
        at: int | str,
        out: Path,
        overrides: Sequence[str] = (),
        *,
        faults: Sequence[str] = (),
        calls: Sequence[str] = (),
        trusted: str | None = None,
    ) -> None:
        opened = Recording(recording)
        change = Change(overrides=overrides, faults=faults, calls=calls)
        self._plan: Plan = plan(opened, at, out, change, trusted)
        self._recording = opened
        self._out = out
        self.scenario: Scenario = self._plan.scenario
        self.notes: Sequence[str] = self._plan.notes

    @property
    def at(self) -> int:
        """Return the first live step."""
        return self._plan.at

    def run(
        self,
        observer: Observer | None = None,
        interrupt: threading.Event | None = None,
        *,
        debug: Sequence[str] = (),
        in_process: bool = False,
        owns_descriptors: bool = False,
    ) -> Branch:
        """Run; arguments as of `stepbus run`. A run that fails has its failure in `result`."""
        found = self._plan
        prefix = RecordedPrefix(self._recording, found.at, found.counts_from)
        options = Options(
            out=self._out,
            prefix=prefix,
            calls=found.calls,
            new_calls=found.new_calls,
            debug=debug,
            in_process=in_process,
            owns_descriptors=owns_descriptors,
        )
        result = run(self.scenario, options, observer, interrupt)
        return Branch(
            recording=self._recording.path,
            at=found.at,
            changed=found.changed,
            recorded_sha256=file_sha256(self._recording.path),
            way_s=prefix.took_s,
            result=result,
            notes=self.notes,
        )


def branch(
    recording: Path,
    at: int | str,
    out: Path,
    overrides: Sequence[str] = (),
    *,
    faults: Sequence[str] = (),
    calls: Sequence[str] = (),
    in_process: bool = False,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Branch:
    """Run a recording again up to a step, and from there with a change; see `BranchPlan`.

    Up to `at`, each participant gets its recorded inputs and has to publish what is recorded;
    `result` has the first that does not. in_process: as of `run`.
    """
    prepared = BranchPlan(recording, at, out, overrides, faults=faults, calls=calls)
    return prepared.run(observer, interrupt, in_process=in_process)
