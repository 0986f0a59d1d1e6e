"""Runs a scenario: the one function behind `stepbus run`, free of global state."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from stepbus_orchestrator.errors import BusFailed, RecordingFailed, RunFailure
from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.endpoints import Mesh, make_mesh, new_token, private_folder
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.recording import McapFile, Recorder, TimingRecorder, layout
from stepbus_orchestrator.scenario import (
    MESSAGE_KINDS,
    Deadlines,
    FaultSpec,
    Scenario,
    Schedule,
    files,
    format_fault,
    resolved,
    start_command,
)
from stepbus_participant import BusError, MessageFault, ZenohBus, suggest
from stepbus_schemas import CallRecord, WiringError

from .control.injector import Injector
from .control.live_file import Live, forget
from .control.pace import Pace
from .events import Events
from .kernel.participants import Member
from .loop import Conductor
from .progress import Observer, Silent
from .result import Result, file_sha256, own_versions
from .supervise import supervise

# Eleven days; in a ticket and for the bus's queries it has to be a finite number [s].
_SUSPENDED_S = 1e6
_NO_DEADLINES = Deadlines(
    spawn_s=_SUSPENDED_S,
    join_s=_SUSPENDED_S,
    ready_s=_SUSPENDED_S,
    step_s=_SUSPENDED_S,
    stop_s=_SUSPENDED_S,
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to run, as opposed to what.

    out: folder of the run's files; made, must be empty. start_order: names of the participants
    in the order they are started; none: that of the scenario. around: is entered before the first
    participant is started and left after the last has ended; it gets them by name as they come.
    pace: holds the run when it is told to. calls: to be made at their steps. debug: names of
    participants that have our terminal and no deadline, to be run in a debugger.
    """

    out: Path
    start_order: Sequence[str] | None = None
    around: Callable[[Mapping[str, Child]], AbstractContextManager[object]] = nullcontext
    pace: Pace | None = None
    calls: Sequence[CallRecord] = ()
    debug: Sequence[str] = ()


def default_folder(scenario: Scenario, parent: Path) -> Path:
    """Make a new folder for a run: `<scenario>-<time>`, or the first free `<scenario>-<time>-<n>`.

    Two runs that start in the same second get different ones. Raises RecordingFailed when it
    cannot be made.
    """
    stem = f"{scenario.name}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
    names = chain([stem], (f"{stem}-{number}" for number in count(2)))
    try:
        parent.mkdir(parents=True, exist_ok=True)
        return next(parent / name for name in names if _is_made(parent / name))
    except OSError as exc:
        raise RecordingFailed(f"cannot make a folder in {parent}: {exc.strerror}") from exc


def _is_made(folder: Path) -> bool:
    """Make a folder; return False where somebody else has made it."""
    try:
        folder.mkdir()
    except FileExistsError:
        return False
    return True


def run(
    scenario: Scenario,
    options: Options,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Result:
    """Run a scenario and return how it ended; result.json says the same.

    observer: is told how it goes. interrupt: ends the run when it is set, e.g. by Ctrl-C.
    A run that fails returns its failure. Raises RecordingFailed when there is no folder to write
    to, WiringError when there is nobody of a name that shall be debugged.
    """
    scenario = without_deadlines(scenario, options.debug)
    return _Run(scenario, options, observer or Silent(), interrupt or threading.Event()).execute()


class _Run:
    """One execution: opens everything, conducts, and closes everything in reverse."""

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
        self._conductor: Conductor | None = None
        self._make_folder()
        self._file = McapFile(options.out / layout.RUN_FILE)
        self._timing = TimingRecorder(options.out / layout.TIMING_FILE)
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        self._events = Events(observer)
        self._recorder = Recorder(self._file, order, scenario.step_ns, self._events.take)
        self._injected: list[str] = []
        self._injector = Injector(scenario.faults, self._note_fault) if scenario.faults else None

    def _note_fault(self, fault: FaultSpec) -> None:
        text = format_fault(fault)
        self._injected.append(text)
        self._timing.event("fault injected", fault.participant, text)
        self._observer.event("warning", fault.participant, fault.step, f"fault injected: {text}")

    def _make_folder(self) -> None:
        out = self._options.out
        try:
            is_used = any(
                (out / name).exists() for name in (layout.RUN_FILE, layout.TIMING_FILE, "logs")
            )
            if not is_used:
                (out / "logs").mkdir(parents=True)
        except OSError as exc:
            raise RecordingFailed(f"cannot make the folder {out}: {exc.strerror}") from exc
        if is_used:
            raise RecordingFailed(f"{out} holds a run already; choose another --out")

    def execute(self) -> Result:
        """Run, close whatever happens, and return the result."""
        failure: RunFailure | None = None
        reason = ""
        try:
            reason = self._inside_private_folder()
        except RunFailure as exc:
            failure = exc
        finally:
            with contextlib.suppress(RunFailure):
                self._recorder.abort()
            self._timing.event("end", text=str(failure) if failure else reason)
            self._timing.close()
        result = self._result(reason, failure)
        try:
            result.save()
        except OSError as exc:
            self._observer.event("error", "orchestrator", result.steps, f"result.json: {exc}")
        return result

    def _inside_private_folder(self) -> str:
        self._attach()
        folder = private_folder()
        logs = self._options.out.resolve() / "logs"
        launcher = Launcher(run=self._run, token=self._token, folder=folder, logs=logs)
        try:
            mesh = make_mesh(self._scenario, folder, self._token)
            with self._options.around(launcher.children):
                return self._on_the_bus(launcher, mesh)
        finally:
            launcher.end_all()

    def _attach(self) -> None:
        """Attach all that is needed to run again from the recording alone."""
        text = resolved(self._scenario)
        self._file.attach(layout.SCENARIO_ATTACHMENT, "application/yaml", text.encode())
        for name, path in files(self._scenario).items():
            try:
                content = path.read_bytes()
            except OSError as exc:
                raise RecordingFailed(f"{path} cannot be read: {exc.strerror}") from exc
            self._file.attach(layout.file_attachment(name), "application/octet-stream", content)
        self._file.add_metadata(layout.ENVIRONMENT_METADATA, own_versions())
        faults = self._scenario.faults
        if faults:
            rows = {f"{n:04}": format_fault(fault) for n, fault in enumerate(faults)}
            self._file.add_metadata(layout.FAULTS_METADATA, rows)

    def _on_the_bus(self, launcher: Launcher, mesh: Mesh) -> str:
        try:
            bus = ZenohBus(mesh.orchestrator, self._run)
        except BusError as exc:
            raise BusFailed(str(exc)) from exc
        try:
            self._conductor = Conductor(
                scenario=self._scenario,
                bus=bus,
                token=self._token,
                recorder=self._recorder,
                timing=self._timing,
                observer=self._observer,
                interrupt=self._interrupt,
                injector=self._injector,
                pace=self._options.pace,
                planned=self._options.calls,
            )
            Live.of(self._run, self._token, mesh.orchestrator).save(self._options.out)
            conductor = self._conductor
            return supervise(conductor, lambda: self._launch(conductor, launcher, mesh))
        finally:
            forget(self._options.out)
            if self._injector is not None and self._conductor is not None:
                self._injector.close(self._conductor.steps)
            bus.close()

    def _launch(self, conductor: Conductor, launcher: Launcher, mesh: Mesh) -> None:
        scenario = self._scenario
        for name in self._options.start_order or [s.name for s in scenario.participants]:
            spec = scenario.participant(name)
            child = launcher.start(
                spec,
                start_command(spec, scenario.folder),
                mesh.participants[name],
                scenario.folder,
                faults=_message_faults(scenario, name),
                has_terminal=name in self._options.debug,
            )
            conductor.state.roster = {**conductor.state.roster, name: Member(spec, child)}
            self._timing.event("spawn", name, f"pid {child.pid}")

    def _result(self, reason: str, failure: RunFailure | None) -> Result:
        conductor = self._conductor
        steps = conductor.steps if conductor else 0
        started = conductor.state.started_at if conductor and conductor.state.started_at else None
        wall_s = conductor.ended_at - started if conductor and started else 0.0
        simulated_s = steps * self._scenario.step_ns * 1e-9
        return Result(
            scenario=self._scenario.name,
            outcome="finished" if failure is None else "failed",
            exit_code=0 if failure is None else int(failure.code),
            reason=reason if failure is None else str(failure),
            participant=failure.participant if failure else None,
            at_step=failure.step if failure else steps,
            steps=steps,
            step_ns=self._scenario.step_ns,
            seed=self._scenario.seed,
            window=self._scenario.window,
            transport=self._scenario.bus.transport,
            start_s=started - self._began if started else 0.0,
            wall_s=wall_s,
            real_time_factor=simulated_s / wall_s if wall_s else 0.0,
            sha256=file_sha256(self._options.out / layout.RUN_FILE),
            folder=str(self._options.out),
            unauthenticated=conductor.state.unauthenticated if conductor else 0,
            drops=conductor.progress().drops if conductor else {},
            faults=self._injected,
            warning_count=self._events.count,
            warnings=self._events.warnings,
            versions=own_versions(),
        )


def without_deadlines(scenario: Scenario, names: Sequence[str]) -> Scenario:
    """Return a scenario in which nobody waits for some participants with a watch in hand.

    Raises WiringError when there is none of a name.
    """
    known = [spec.name for spec in scenario.participants]
    for name in names:
        if name not in known:
            raise WiringError(f"no participant {name!r} to debug{suggest(name, known)}")
    specs = (
        dataclasses.replace(s, deadlines=_NO_DEADLINES) if s.name in names else s
        for s in scenario.participants
    )
    return dataclasses.replace(scenario, participants=tuple(specs))


def _message_faults(scenario: Scenario, name: str) -> list[MessageFault]:
    return [
        MessageFault(type=fault.kind, step=fault.step, duration_s=(fault.duration_ns or 0) * 1e-9)
        for fault in scenario.faults
        if fault.participant == name and fault.kind in MESSAGE_KINDS
    ]
