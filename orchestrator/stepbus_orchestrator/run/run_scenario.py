"""Runs a scenario: the one function behind `stepbus run`, free of global state."""

import contextlib
import dataclasses
import os
import threading
import time
from collections.abc import Callable, Sequence
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
    CheckpointWriter,
    McapFile,
    Recorder,
    Sink,
    TimingRecorder,
    layout,
)
from stepbus_orchestrator.scenario import (
    FaultSpec,
    Scenario,
    Schedule,
    builtin_folders,
    check_installed,
    format_fault,
    left_out,
)
from stepbus_participant import Bus, is_shared, make_new_folder

from .bus.session import Session, open_bus
from .control.injector import Injector
from .control.invitations import Invitations
from .control.live_file import Live, forget
from .control.real_time import RealTime
from .kernel.gates import Gate
from .loop.loop import Controls, Records, RunLoop
from .loop.strategy import Strategy
from .phases import run_phases
from .reports.events import Events
from .reports.progress import Observer, Silent
from .reports.result import Result, file_sha256, own_versions
from .setup.external import as_children, check_external, external_names
from .setup.folder import LOGS_FOLDER, attach, claim, default_folder
from .setup.live_run import LiveRun
from .setup.opened_files import OpenedFiles
from .setup.options import PROFILE_FOLDER, Options, without_deadlines
from .setup.unrecorded import NoRecorder, NoTiming

__all__ = [
    "Options",
    "default_folder",
    "external_names",
    "run",
    "run_with",
    "without_deadlines",
]

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
    participants needs is not installed, WiringError for a name in `options` that no participant
    has, and for what cannot be done to one that somebody else starts.
    """
    return run_with(lambda live: live, scenario, options, observer, interrupt)


def run_with(
    adapt: Callable[[Strategy], Strategy],
    scenario: Scenario,
    options: Options,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Result:
    """Run a scenario with another strategy than that of a run, which `adapt` gets; see `run`."""
    if not options.admits_external:
        scenario = as_children(scenario)
    check_external(scenario, options)
    if options.real_time is not None:
        # Each step begins when all have finished the one before, and its time has come.
        scenario = dataclasses.replace(scenario, window=1, batch=1)
    scenario = without_deadlines(scenario, [*options.debug, *options.no_deadline])
    check_installed(scenario)
    check_limits(len(scenario.participants))
    return _Run(
        adapt, scenario, options, observer or Silent(), interrupt or threading.Event()
    ).execute()


class _Run:
    """One execution: opens everything, goes through the phases, closes everything in reverse."""

    def __init__(
        self,
        adapt: Callable[[Strategy], Strategy],
        scenario: Scenario,
        options: Options,
        observer: Observer,
        interrupt: threading.Event,
    ) -> None:
        self._adapt = adapt
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
        if options.profile:
            make_new_folder(options.out / PROFILE_FOLDER)
        # A run in one process works in the scenario's folder.
        out = options.out.resolve()
        self._file = McapFile(out / layout.RUN_FILE) if options.is_recorded else None
        self._timing = (
            TimingRecorder(out / layout.TIMING_FILE) if options.is_recorded else NoTiming()
        )
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        self._events = Events(observer)
        self._invitations = Invitations(out, observer)
        if is_shared(out):
            self._events.add_warning(
                "orchestrator", _SHARED.format(folder=options.out, out=argument("--out"))
            )
        factor = options.real_time
        self._real_time = None if factor is None else RealTime(scenario.step_ns, factor)
        self._recorder = (
            NoRecorder(order, self._events.take)
            if self._file is None
            else Recorder(self._file, order, scenario.step_ns, self._events.take, scenario.types)
        )
        self._checkpoints = (
            CheckpointWriter(out) if scenario.checkpoint_steps and options.is_recorded else None
        )
        self._injected: list[str] = []
        faults = self._live_scenario().faults
        self._injector = Injector(faults, self._add_fault) if faults else None

    def _add_fault(self, fault: FaultSpec) -> None:
        text = format_fault(fault)
        self._injected.append(text)
        self._timing.event("fault injected", fault.participant, text)
        self._observer.event("warning", fault.participant, fault.step, f"fault injected: {text}")

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
        self._finish_checkpoints(result)
        return result

    def _finish_checkpoints(self, result: Result) -> None:
        """Bind the checkpoints to the recording; without, they are of no use, and no more."""
        try:
            if self._checkpoints is not None:
                self._checkpoints.finish(result.sha256)
        except RecordingFailed as exc:
            self._observer.event("error", "orchestrator", result.steps, str(exc))

    def _recorded(self, file: McapFile) -> str:
        names = attach(file, self._scenario)
        if self._options.prefix is not None and self._options.prefix.counts_from:
            rows = self._options.prefix.counts_from.items()
            content = {name: str(step) for name, step in rows}
            file.add_metadata(layout.BRANCH_METADATA, content)
        if self._options.seat is not None:
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
        from .inprocess import NATIVE_LOG, LocalRun, Surroundings  # noqa: PLC0415  see above

        logs = self._options.out.resolve() / LOGS_FOLDER
        local = LocalRun(
            run=self._run,
            token=self._token,
            logs=logs,
            timing=self._timing,
            options=self._options,
            interrupt=self._interrupt,
            result=lambda: msgspec.json.encode(self._result("", None)),
        )
        native_log = logs / NATIVE_LOG if self._options.owns_descriptors else None
        with contextlib.ExitStack() as stack:
            try:
                around = Surroundings(self._scenario.folder, local.guard, native_log)
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
            is_star = self._options.prefix is not None
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
            stack.callback(self._invitations.close)
            live = LiveRun(launcher, mesh, self._timing, self._options, self._invitations)
            return self._run_phases(bus, live)

    def _run_phases(self, bus: Bus, live: Strategy) -> str:
        session = Session(self._live_scenario(), bus, self._token)
        strategy, gate = self._adapt(live), None
        recorder: Sink = self._recorder
        if self._options.prefix is not None:
            strategy, recorder, gate = self._options.prefix.join(
                strategy, session, recorder, self._timing
            )
        loop = self._loop = RunLoop(
            session,
            strategy,
            Records(recorder=recorder, timing=self._timing, checkpoints=self._checkpoints),
            self._controls(gate),
        )
        try:
            return run_phases(loop)
        finally:
            if self._injector is not None:
                self._injector.close(loop.state.steps)

    def _live_scenario(self) -> Scenario:
        """Return the scenario without the faults that a recording has the outcome of."""
        prefix = self._options.prefix
        first = 0 if prefix is None else prefix.at
        faults = tuple(fault for fault in self._scenario.faults if fault.step >= first)
        # Whoever has a seat sees the outcome of the last step, and ends the run there.
        steps = self._scenario.steps if self._options.seat is None else None
        return dataclasses.replace(self._scenario, faults=faults, steps=steps)

    def _controls(self, prefix: Gate | None) -> Controls:
        return Controls(
            observer=self._observer,
            interrupt=self._interrupt,
            injector=self._injector,
            pace=self._options.pace,
            prefix=prefix,
            calls=self._options.calls,
            new_calls=self._options.new_calls,
            invitations=self._invitations,
            real_time=self._real_time,
        )

    def _result(self, reason: str, failure: RunFailure | None) -> Result:
        loop, scenario = self._loop, self._scenario
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
            faults=self._injected,
            warning_count=self._events.count,
            warnings=self._events.warnings,
            versions=own_versions(),
            file=str(scenario.file),
            overrides=scenario.overrides,
            real_time=None if self._real_time is None else self._real_time.lateness(),
        )
