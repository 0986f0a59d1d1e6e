"""Runs a scenario several times under different conditions; the recordings must be equal."""

import contextlib
import dataclasses
import shutil
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import msgspec
import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.run.extensions.faults import Delays
from stepbus_orchestrator.run.hosts import InProcess, Processes
from stepbus_orchestrator.run.inprocess.local_run import check_scenario
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.model import Scenario, Transport
from stepbus_participant import make_new_folder
from stepbus_schemas import WiringError

WINDOWS = (1, 2, 8, 64)
TRANSPORTS: tuple[Transport, ...] = ("tcp", "unix")


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """The conditions of one run, none of which may change its result.

    number: from 1 on. start_order: names of the participants. delayed: whether they are delayed
    at random while they run. in_process: whether all participants share one process; then there is
    no transport and no delay.
    """

    number: int
    window: int
    transport: Transport
    start_order: tuple[str, ...]
    delayed: bool
    in_process: bool = False


class TrialResult(msgspec.Struct, frozen=True, kw_only=True):
    """The run of one trial. delays: how often a participant was delayed."""

    trial: Trial
    result: Result
    delays: int

    @property
    def steps_per_s(self) -> float:
        """Return the number of steps per second of wall time; 0 without any."""
        return self.result.steps / self.result.wall_s if self.result.wall_s else 0.0


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Result of a verification: all trials, up to the first that failed or differed.

    results: in order, at least one. folder: folder of the runs.
    """

    results: tuple[TrialResult, ...]
    folder: Path

    @property
    def failed(self) -> TrialResult | None:
        """Return the trial that failed, if one did."""
        last = self.results[-1]
        return last if last.result.exit_code else None

    @property
    def different(self) -> tuple[TrialResult, TrialResult] | None:
        """Return the first trial and the one that differs from it, if one does."""
        first, last = self.results[0], self.results[-1]
        if self.failed or first.result.sha256 == last.result.sha256:
            return None
        return first, last


def plan(scenario: Scenario, count: int, seed: int, *, in_process: bool = False) -> list[Trial]:
    """Return `count` trials: the scenario as it is, then shuffled starts, delays, other windows.

    Windows and transports take turns, so that each pair of them comes once in eight trials.
    in_process: add one in which all participants share a process, where the scenario can.
    """
    names = tuple(spec.name for spec in scenario.participants)
    generator = np.random.default_rng(seed)
    plain = Trial(
        number=1,
        window=scenario.window,
        transport=scenario.bus.transport,
        start_order=names,
        delayed=False,
    )
    others = [
        Trial(
            number=index + 2,
            window=WINDOWS[index % 4],
            transport=TRANSPORTS[(index + index // 4) % 2],
            start_order=tuple(names[at] for at in generator.permutation(len(names))),
            delayed=True,
        )
        for index in range(count - 1)
    ]
    trials = [plain, *others]
    with contextlib.suppress(WiringError):
        if in_process:
            check_scenario(scenario)
            trials.append(msgspec.structs.replace(plain, number=count + 1, in_process=True))
    return trials


def verify(
    scenario: Scenario,
    *,
    runs: int = 5,
    seed: int = 0,
    out: str | PathLike[str] | None = None,
    on_result: Callable[[TrialResult, int], None] = lambda _result, _count: None,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
    owns_descriptors: bool = False,
) -> Verification:
    """Run a scenario several times, until one fails or differs from the first.

    runs: number of runs in separate processes. seed: seed of the start orders and delays. out: keep
    the runs in this new folder. Default: a temporary one, which stays only where a run failed or
    differed. on_result: gets each trial when it has ended, and how many there are. observer:
    watches each run. interrupt: ends the current run, as a failure. owns_descriptors: whether this
    process can host all participants too, as of `InProcess`; then it does, last.

    Raises RecordingFailed when the folder cannot be made.
    """
    trials = plan(scenario, runs, seed, in_process=owns_descriptors)
    try:
        folder = Path(tempfile.mkdtemp(prefix="verify-stepbus-") if out is None else out)
        if out is not None:
            make_new_folder(folder)
    except OSError as exc:
        raise RecordingFailed(
            f"cannot create folder {out}: {exc.strerror}; choose a new one with --out"
        ) from exc
    verification = Verification(results=(), folder=folder)
    try:
        for trial in trials:
            delays = Delays((seed, trial.number))
            options = Options(
                out=folder / str(trial.number),
                host=InProcess(owns_descriptors=owns_descriptors)
                if trial.in_process
                else Processes(start_order=trial.start_order),
                extensions=[delays] if trial.delayed else [],
            )
            result = run(_changed(scenario, trial), options, observer, interrupt)
            done = TrialResult(trial=trial, result=result, delays=delays.count)
            on_result(done, len(trials))
            verification = Verification(results=(*verification.results, done), folder=folder)
            if verification.failed or verification.different:
                return verification
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()
    if out is None:
        shutil.rmtree(folder)
    return verification


def _changed(scenario: Scenario, trial: Trial) -> Scenario:
    return dataclasses.replace(
        scenario,
        window=trial.window,
        batch=scenario.batch if trial.number == 1 else max(1, trial.window // 2),
        bus=msgspec.structs.replace(scenario.bus, transport=trial.transport),
    )
