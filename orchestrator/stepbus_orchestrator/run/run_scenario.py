"""Runs a scenario: the one function behind `stepbus run`, free of global state."""

import contextlib
import dataclasses
import os
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import RecordingFailed, RunFailure, StartFailed, argument
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.processes.limits import check_limits
from stepbus_orchestrator.processes.links.endpoints import (
    Mesh,
    make_mesh,
    new_token,
    private_folder,
)
from stepbus_orchestrator.recording import (
    McapFile,
    Recorder,
    TimingRecorder,
    layout,
)
from stepbus_orchestrator.scenario import (
    Scenario,
    Schedule,
    builtin_folders,
    check_installed,
    left_out,
)
from stepbus_participant import Bus, is_shared

from .bus.session import Session, open_bus
from .extension import overriding
from .extensions import with_defaults
from .live_file import Live, forget
from .loop.loop import RunLoop
from .loop.strategy import Strategy
from .phases import run_phases
from .reports.events import Events
from .reports.progress import Observer, Silent
from .reports.result import Result, file_sha256, own_versions
from .setup.folder import LOGS_FOLDER, attach, claim, default_folder
from .setup.live_run import LiveRun
from .setup.opened_files import OpenedFiles
from .setup.options import Options
from .setup.unrecorded import NoRecorder, NoTiming

__all__ = ["Options", "default_folder", "run"]

_SHARED = (
    "{folder} may be written by every user of this machine, who could put files of theirs in the "
    "place of the run's; choose another {out}, or take that right away: chmod o-w {folder}"
)


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
    participants needs is not installed, WiringError where an extension cannot do its work in this
    scenario.
    """
    extensions = with_defaults(scenario, options.extensions, is_recorded=options.is_recorded)
    for extension in extensions:
        scenario = extension.prepare(scenario)
    if overriding(extensions, "completed"):
        scenario = dataclasses.replace(scenario, window=1, batch=1)
    check_installed(scenario)
    check_limits(len(scenario.participants))
    options = dataclasses.replace(options, extensions=extensions)
    return _Run(scenario, options, observer or Silent(), interrupt or threading.Event()).execute()


class _Run:
    """One execution: opens everything, goes through the phases, closes everything in reverse."""

    def __init__(
        self, scenario: Scenario, options: Options, observer: Observer, interrupt: threading.Event
    ) -> None:
        self._scenario = scenario
        self._options = options
        self._observer = observer
        self._interrupt = interrupt
        self._began = time.monotonic()
        self._token = new_token()
        self._run = new_token()
        self._loop: RunLoop | None = None
        self._processes: set[int] = set()
        if options.in_process:
            from .inprocess import check_scenario  # noqa: PLC0415  see `_with_hub`

            check_scenario(scenario)
        claim(options.out)
        # A run in one process works in the scenario's folder.
        out = options.out.resolve()
        self._file = McapFile(out / layout.RUN_FILE) if options.is_recorded else None
        self._timing = (
            TimingRecorder(out / layout.TIMING_FILE) if options.is_recorded else NoTiming()
        )
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        self._events = Events(observer)
        if is_shared(out):
            self._events.add_warning(
                "orchestrator", _SHARED.format(folder=options.out, out=argument("--out"))
            )
        self._recorder = (
            NoRecorder(order, self._events.take)
            if self._file is None
            else Recorder(self._file, order, scenario.step_ns, self._events.take, scenario.types)
        )

    def execute(self) -> Result:
        """Run, close whatever happens, and return the result."""
        failure: RunFailure | None = None
        reason = ""
        try:
            reason = self._with_participants() if self._file is None else self._recorded(self._file)
        except RunFailure as exc:
            failure = exc
        except OSError as exc:
            failure = self._translated(exc)
        finally:
            failure = self._close_recording(failure)
            self._timing.event("end", text=str(failure) if failure else reason)
            self._timing.close()
        if failure is None and self._loop is not None:
            self._events.add_silent(self._scenario, self._recorder.silent, self._loop.state.steps)
        result = self._result(reason, failure)
        if self._file is None:
            return result
        try:
            result.save()
        except OSError as exc:
            self._observer.event("error", "orchestrator", result.steps, f"result.json: {exc}")
        for extension in self._options.extensions:
            try:
                extension.finish(result)
            except RecordingFailed as exc:
                self._observer.event("error", "orchestrator", result.steps, str(exc))
        return result

    def _recorded(self, file: McapFile) -> str:
        names = attach(file, self._scenario)
        for extension in self._options.extensions:
            for name, content in extension.metadata().items():
                file.add_metadata(name, content)
        if any(extension.is_hosting for extension in self._options.extensions):
            # What our caller reads is not what the run reads.
            return self._with_participants()
        with OpenedFiles(self._own_folder(), self._options.out) as opened:
            reason = self._with_participants()
            self._warn_of_rerun(opened, names)
        return reason

    def _translated(self, exc: OSError) -> RunFailure:
        """Return the failure for what nobody expected of a file, by the folder it is in."""
        is_ours = str(exc.filename).startswith(str(self._options.out.resolve()))
        error = RecordingFailed if is_ours else RunFailure
        return error(f"{exc.filename or 'this machine'}: {exc.strerror or exc}")

    def _own_folder(self) -> Path | None:
        """Return the scenario's folder; None for one that ships, whose files are recorded."""
        folder = self._scenario.folder
        is_shipped = any(folder.is_relative_to(shipped) for shipped in builtin_folders())
        return None if is_shipped else folder

    def _warn_of_rerun(self, opened: OpenedFiles, known: Sequence[str]) -> None:
        """Warn where a rerun would not find what this run did; known: files that are recorded."""
        missing = opened.read_beside(known, self._processes)
        declare = "declare it in `files` of its participant"
        if not opened.knows_readers:
            declare += ", if it is one of them that read it"
        for what in (*left_out(self._scenario), *(f"{name}; {declare}" for name in missing)):
            self._events.add_warning("recording", f"a rerun does not find {what}")

    def _close_recording(self, failure: RunFailure | None) -> RunFailure | None:
        """Write what has arrived of a run that failed; check the file of one that finished.

        Return what the run failed from.
        """
        try:
            if self._loop is None or not self._loop.is_recorded:
                self._recorder.abort()
            if failure is None and self._file is not None:
                self._file.check()
        except RunFailure as exc:
            return failure or exc
        return failure

    def _with_participants(self) -> str:
        return self._with_hub() if self._options.in_process else self._with_processes()

    def _with_hub(self) -> str:
        # A run in processes of their own is quicker to start without it.
        from .inprocess import NATIVE_LOG, LocalRun, ScenarioModules, Surroundings  # noqa: PLC0415

        logs = self._options.out.resolve() / LOGS_FOLDER
        sources = (spec.participant.rpartition(":")[0] for spec in self._scenario.participants)
        files = [source for source in sources if source.endswith(".py")]
        modules = ScenarioModules(self._scenario.folder, files)
        local = LocalRun(
            run=self._run,
            token=self._token,
            logs=logs,
            options=self._options,
            modules=modules,
            interrupt=self._interrupt,
            result=lambda: msgspec.json.encode(self._result("", None)),
        )
        native_log = logs / NATIVE_LOG if self._options.owns_descriptors else None
        with contextlib.ExitStack() as stack:
            try:
                around = Surroundings(self._scenario.folder, modules, local.guard, native_log)
                stack.enter_context(around)
            except OSError as exc:
                raise StartFailed(
                    f"before the first step: {exc.filename}: {exc.strerror}; a run in one process "
                    "works in the scenario's folder, and logs to the run's"
                ) from exc
            stack.enter_context(local.watched(around))
            try:
                return self._run_phases(local.bus, local)
            finally:
                self._processes.update((os.getpid(), *local.groups))

    def _with_processes(self) -> str:
        logs = self._options.out.resolve() / LOGS_FOLDER
        folder = private_folder()
        launcher = Launcher(run=self._run, token=self._token, folder=folder, logs=logs)
        try:
            is_star = any(item.is_star for item in self._options.extensions)
            mesh = make_mesh(self._scenario, folder, self._run, is_star=is_star)
            with self._options.around(launcher.children):
                return self._with_bus(launcher, mesh)
        finally:
            self._processes.update(child.pid for child in launcher.children.values())
            for left in launcher.end_all():
                self._events.add_warning(left.participant, left.text())

    def _with_bus(self, launcher: Launcher, mesh: Mesh) -> str:
        with contextlib.ExitStack() as stack:
            bus = open_bus(mesh.orchestrator, self._run)
            stack.callback(bus.close)
            live_file = Live(run=self._run, token=self._token, endpoint=mesh.caller)
            live_file.save(self._options.out)
            stack.callback(forget, self._options.out)
            return self._run_phases(bus, LiveRun(launcher, mesh, self._options))

    def _run_phases(self, bus: Bus, strategy: Strategy) -> str:
        adapted = self._scenario
        for extension in self._options.extensions:
            adapted = extension.adapt(adapted)
        loop = self._loop = RunLoop(
            Session(adapted, bus, self._token),
            strategy,
            self._recorder,
            self._timing,
            out=self._options.out,
            observer=self._observer,
            interrupt=self._interrupt,
            extensions=self._options.extensions,
        )
        try:
            return run_phases(loop)
        finally:
            loop.close()

    def _result(self, reason: str, failure: RunFailure | None) -> Result:
        loop, scenario = self._loop, self._scenario
        extensions = self._options.extensions if loop else ()
        steps = loop.state.steps if loop else 0
        started = loop.state.started_at if loop and loop.state.started_at else None
        wall_s = loop.ended_at - started if loop and started else 0.0
        simulated_s = steps * scenario.step_ns * 1e-9
        return Result(
            scenario=scenario.name,
            outcome="finished" if failure is None else "failed",
            exit_code=0 if failure is None else int(failure.code),
            reason=reason if failure is None else str(failure),
            participant=failure.participant if failure else None,
            at_step=failure.step if failure else steps,
            steps=steps,
            step_ns=scenario.step_ns,
            seed=scenario.seed,
            window=scenario.window,
            transport=scenario.bus.transport,
            start_s=started - self._began if started else 0.0,
            wall_s=wall_s,
            real_time_factor=simulated_s / wall_s if wall_s else 0.0,
            sha256=file_sha256(self._options.out / layout.RUN_FILE),
            messages_sha256=self._recorder.messages_sha256,
            folder=str(self._options.out),
            unauthenticated=loop.state.unauthenticated if loop else 0,
            drops=loop.progress().drops if loop else {},
            warning_count=self._events.count,
            warnings=self._events.warnings,
            versions=own_versions(),
            file=str(scenario.file),
            overrides=scenario.overrides,
            **{name: value for item in extensions for name, value in item.result().items()},
        )
