"""Runs a scenario: the one function behind `stepbus run`, free of global state."""

import dataclasses
import threading
from collections.abc import Sequence
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import RecordingFailed, RunFailure
from stepbus_orchestrator.processes.endpoints import new_token
from stepbus_orchestrator.processes.limits import check_limits
from stepbus_orchestrator.run.bus import Session
from stepbus_orchestrator.run.extension import RunExtension, overriding
from stepbus_orchestrator.run.extensions import with_defaults
from stepbus_orchestrator.run.folder import LOGS_FOLDER, claim, default_folder
from stepbus_orchestrator.run.host import Host, Opening
from stepbus_orchestrator.run.hosts import InProcess, Processes
from stepbus_orchestrator.run.phases import run_phases
from stepbus_orchestrator.run.reports import Events, Observer, Silent
from stepbus_orchestrator.run.result import Result, result_of
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.run.run_files import RunFiles
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.program import check_installed

__all__ = ["Options", "default_folder", "host_of", "run"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """How to run, as opposed to what.

    out: folder of the run's files; made, must be empty. host: where it takes place; default: each
    participant in a process of its own. is_recorded: whether the run writes run.mcap, timing.mcap
    and result.json. extensions: features of the run, beside those that every run has.
    """

    out: Path
    host: Host = dataclasses.field(default_factory=Processes)
    is_recorded: bool = True
    extensions: Sequence[RunExtension] = ()


def host_of(*, in_process: bool, owns_descriptors: bool = False) -> Host:
    """Return the host of a run; owns_descriptors: as of `InProcess`."""
    return InProcess(owns_descriptors=owns_descriptors) if in_process else Processes()


def run(
    scenario: Scenario,
    options: Options,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Result:
    """Run a scenario and return how it ended; result.json has the same.

    observer: is notified of progress. interrupt: ends the run when it is set, e.g. by Ctrl-C.
    A run that fails returns its failure. Raises RecordingFailed when there is no folder to write
    to, StartFailed when it may not open enough files, ExtraMissing where a package that one of our
    participants needs is not installed, WiringError where the host cannot run this scenario, or an
    extension cannot do its work in it.
    """
    extensions = with_defaults(scenario, options.extensions, is_recorded=options.is_recorded)
    for extension in extensions:
        scenario = extension.prepare(scenario)
    if overriding(extensions, "completed"):
        scenario = dataclasses.replace(scenario, window=1, batch=1)
    check_installed(scenario)
    check_limits(len(scenario.participants))
    options.host.check(scenario)
    claim(options.out)
    options = dataclasses.replace(options, extensions=extensions)
    return _Execution(
        scenario, options, observer or Silent(), interrupt or threading.Event()
    ).execute()


class _Execution:
    """Opens the files and the host of one run, and closes them whatever happens."""

    def __init__(
        self, scenario: Scenario, options: Options, observer: Observer, interrupt: threading.Event
    ) -> None:
        self._began = options.host.clock.monotonic()
        self._scenario = scenario
        self._options = options
        self._observer = observer
        self._interrupt = interrupt
        self._events = Events(observer)
        self._files = RunFiles(
            scenario, options.out, self._events, options.host, is_recorded=options.is_recorded
        )
        self._run: Run | None = None

    def execute(self) -> Result:
        """Run, and return the result."""
        reason, failure = "", None
        try:
            self._files.describe(self._options.extensions)
            reason = self._take_place()
            self._files.warn_of_rerun()
        except RunFailure as exc:
            failure = exc
        except OSError as exc:
            failure = self._files.translated(exc)
        finally:
            is_recorded = self._run is not None and self._run.is_recorded
            ending = self._files.close(reason, failure, is_recorded=is_recorded)
        if self._run is not None and not isinstance(ending, RunFailure):
            silent = self._files.recorder.silent
            self._events.add_silent(self._scenario, silent, self._run.state.steps)
        result = self._result(ending)
        if self._options.is_recorded:
            self._save(result)
        return result

    def _save(self, result: Result) -> None:
        try:
            result.save(self._options.host.disk)
        except OSError as exc:
            self._observer.event("error", "orchestrator", result.steps, f"result.json: {exc}")
        for extension in self._options.extensions:
            try:
                extension.finish(result)
            except RecordingFailed as exc:
                self._observer.event("error", "orchestrator", result.steps, str(exc))

    def _take_place(self) -> str:
        """Go through the phases on the host, and return why the run ended."""
        opening = Opening(
            scenario=self._scenario,
            out=self._files.out,
            logs=self._files.out / LOGS_FOLDER,
            run=new_token(),
            token=new_token(),
            extensions=self._options.extensions,
            interrupt=self._interrupt,
            warn=self._events.add_warning,
            result=lambda: msgspec.json.encode(self._result("")),
        )
        adapted = self._scenario
        for extension in self._options.extensions:
            adapted = extension.adapt(adapted)
        with self._options.host.open(opening) as (bus, strategy):
            run = self._run = Run(
                Session(adapted, bus, opening.token),
                strategy,
                self._files.recorder,
                self._files.timing,
                out=self._options.out,
                observer=self._observer,
                interrupt=self._interrupt,
                extensions=self._options.extensions,
            )
            try:
                return run_phases(run)
            finally:
                run.extensions.close()

    def _result(self, ending: str | RunFailure) -> Result:
        return result_of(
            self._scenario,
            ending,
            run=self._run,
            began=self._began,
            folder=self._options.out,
            messages_sha256=self._files.recorder.messages_sha256,
            events=self._events,
            fields={
                name: value
                for item in (self._options.extensions if self._run else ())
                for name, value in item.result().items()
            },
        )
