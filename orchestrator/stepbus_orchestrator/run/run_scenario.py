"""Runs a scenario: the one function behind `stepbus run`, free of global state."""

import contextlib
import dataclasses
import os
import threading
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import ParticipantFault, RecordingFailed, RunFailure
from stepbus_orchestrator.processes.limits import check_limits
from stepbus_orchestrator.recording import McapFile, Recorder, Sink, TimingRecorder, layout
from stepbus_orchestrator.run.extension import Host, RunExtension, overriding
from stepbus_orchestrator.run.extensions import with_defaults
from stepbus_orchestrator.run.folder import (
    HEAD_BYTES,
    LOGS_FOLDER,
    claim,
    default_folder,
    read_files,
    warnings_in,
)
from stepbus_orchestrator.run.hosts import InProcess, Processes
from stepbus_orchestrator.run.reports import Events, Observer
from stepbus_orchestrator.run.result import Result, file_sha256, own_versions
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario.fault_texts import format_fault
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.program import check_installed
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import is_shared
from stepbus_schemas import Decoder, Event, MessageError, Outputs, type_name

__all__ = ["Options", "default_folder", "host_of", "run"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """How to run, as opposed to what.

    out: folder of the run's files; made, must be empty; default: `runs/<scenario>-<time>`. host:
    where it takes place; default: each participant in a process of its own. is_recorded: whether
    the run writes run.mcap, timing.mcap and result.json. extensions: features of the run, beside
    those that every run has.
    """

    out: Path | None = None
    host: Host = dataclasses.field(default_factory=Processes)
    is_recorded: bool = True
    extensions: Sequence[RunExtension] = ()


def host_of(*, in_process: bool, owns_descriptors: bool = False, is_star: bool = False) -> Host:
    """Return the host of a run; owns_descriptors, is_star: as of `InProcess`."""
    if in_process:
        return InProcess(owns_descriptors=owns_descriptors, is_star=is_star)
    return Processes(is_star=is_star)


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
    adapted = scenario
    for extension in extensions:
        adapted = extension.adapt(adapted)
    options = dataclasses.replace(options, extensions=extensions)
    # Not before: a run that cannot start leaves no folder.
    out = options.out or default_folder(scenario, Path("runs"))
    claim(out)
    observer = observer or Observer()
    return _Execution(scenario, adapted, options, observer, interrupt, out=out).execute()


_SHARED = (
    "{folder} is writable by every user of this machine, who could replace the run's "
    "files; choose another --out, or remove that permission: chmod o-w {folder}"
)


class _Execution:
    """Opens the files of one run, and closes them whatever happens.

    adapted: the scenario as its participants get it. out: the folder of the run.
    """

    def __init__(
        self,
        scenario: Scenario,
        adapted: Scenario,
        options: Options,
        observer: Observer,
        interrupt: threading.Event | None,
        *,
        out: Path,
    ) -> None:
        host = options.host
        self._began = host.clock.monotonic()
        self._scenario = scenario
        self._options = options
        self._observer = observer
        self._events = Events(observer)
        self._folder = out
        # A run in one process works in the scenario's folder.
        self._out = out.resolve()
        self._file: McapFile | None = None
        order = [scenario.participant(name) for name in Schedule(scenario).order]
        self._recorder: Recorder | _NoRecorder = _NoRecorder(order, self._events)
        timing = None
        if options.is_recorded:
            # A simulated disk knows no threads.
            path, is_real = self._out / layout.RUN_FILE, host.disk is os
            self._file = McapFile(path, host.disk, in_background=is_real)
            self._recorder = Recorder(
                self._file, order, scenario.step_ns, self._events.take, scenario.types
            )
            timing = self._out / layout.TIMING_FILE
        self._timing = TimingRecorder(timing, host.clock, host.disk)
        if is_shared(self._out):
            text = _SHARED.format(folder=out)
            self._events.add_warning("orchestrator", text)
        self._run = Run(
            adapted,
            self._recorder,
            self._timing,
            out=self._out,
            observer=observer,
            interrupt=interrupt,
            extensions=options.extensions,
            warn=self._events.add_warning,
            result=lambda: msgspec.json.encode(self._result("")),
        )

    def execute(self) -> Result:
        """Run, and return the result."""
        reason, failure = "", None
        try:
            if self._file is not None:
                self._describe(self._file)
            reason = self._run.take_place(self._options.host)
            if self._file is not None:
                for what in self._scenario.left_out:
                    self._events.add_warning("recording", f"a rerun does not find {what}")
        except RunFailure as exc:
            failure = exc
        except OSError as exc:
            # It was not expected of any file.
            kind = RecordingFailed if str(exc.filename).startswith(str(self._out)) else RunFailure
            failure = kind(f"{exc.filename or 'this machine'}: {exc.strerror or exc}")
        except MemoryError:
            failure = RunFailure("the orchestrator has no memory left; raise its limit (ulimit -v)")
        finally:
            ending = self._close(reason, failure)
        self._add_logged()
        if not isinstance(ending, RunFailure):
            self._events.add_silent(self._scenario, self._recorder.silent, self._run.state.steps)
        result = self._result(ending)
        if self._options.is_recorded:
            self._save(result)
        return result

    def _add_logged(self) -> None:
        """Add the warnings that participants have logged."""
        for spec in self._scenario.participants:
            log = self._out / LOGS_FOLDER / f"{spec.name}.log"
            with contextlib.suppress(OSError), log.open("rb") as file:
                for text in warnings_in(file.read(HEAD_BYTES)):
                    self._events.add_warning(spec.name, text)

    def _describe(self, file: McapFile) -> None:
        """Record all that is needed to run again; raises RecordingFailed."""
        text, contents = resolved(self._scenario).encode(), read_files(self._scenario.files)
        file.attach_scenario(text, contents)
        file.add_metadata(layout.ENVIRONMENT_METADATA, own_versions())
        faults = enumerate(map(format_fault, self._scenario.faults))
        if rows := {f"{number:04}": text for number, text in faults}:
            file.add_metadata(layout.FAULTS_METADATA, rows)

    def _close(self, reason: str, failure: RunFailure | None) -> str | RunFailure:
        """Write what has arrived of a run that failed; check the file of one that finished.

        Return why it ended, or what it failed from.
        """
        try:
            if not self._run.is_recorded:
                self._recorder.abort()
            if failure is None and self._file is not None:
                self._file.check()
        except RunFailure as exc:
            failure = failure or exc
        self._timing.event("end", text=str(failure or reason))
        self._timing.close()
        return failure or reason

    def _result(self, ending: str | RunFailure) -> Result:
        """Return the result of the run, or what it would be were the run over now.

        ending: why it ended, or what it failed from.
        """
        fields: dict[str, Any] = {}
        for extension in self._options.extensions if self._run.is_attached else ():
            fields |= extension.result()
        failure = ending if isinstance(ending, RunFailure) else None
        scenario, state, folder = self._scenario, self._run.state, self._folder
        started, participants = state.started_at, state.participants.values()
        wall_s = self._run.ended_at - started if started else 0.0
        simulated_s = state.steps * scenario.step_ns * 1e-9
        cause = str(ending)
        for part in (part for one in participants for part in one.local()):
            cause = cause.replace(part, "")
        return Result(
            scenario=scenario.name,
            outcome="finished" if failure is None else "failed",
            exit_code=0 if failure is None else int(failure.code),
            reason=str(ending),
            cause=cause.replace(str(folder), "."),
            participant=failure.participant if failure else None,
            at_step=failure.step if failure else state.steps,
            steps=state.steps,
            step_ns=scenario.step_ns,
            seed=scenario.seed,
            window=scenario.window,
            transport=scenario.bus.transport,
            start_s=started - self._began if started else 0.0,
            wall_s=wall_s,
            real_time_factor=simulated_s / wall_s if wall_s else 0.0,
            sha256=file_sha256(folder / layout.RUN_FILE),
            messages_sha256=self._recorder.messages_sha256,
            folder=str(folder),
            unauthenticated=state.unauthenticated,
            drops={item.name: sum(item.drops.values()) for item in participants},
            warning_count=self._events.count,
            warnings=self._events.warnings,
            versions=own_versions(),
            file=str(scenario.file),
            overrides=scenario.overrides,
            **fields,
        )

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


class _NoRecorder(Sink):
    """The sink of a run that is not recorded; events are reported all the same."""

    messages_sha256 = ""
    silent: Collection[tuple[str, str]] = frozenset()

    def __init__(self, order: Sequence[ParticipantSpec], events: Events) -> None:
        nothing = {spec.name: dict.fromkeys(spec.outputs, 0) for spec in order}
        super().__init__(nothing, nothing)
        self._events = events
        self._decode = Decoder(Event)
        self._ports = {
            spec.name: [port for port, row in spec.outputs.items() if row.type == type_name(Event)]
            for spec in order
        }

    def offer(self, name: str, outputs: Outputs) -> None:
        """Report the events among the outputs of one participant."""
        for port in self._ports[name]:
            if port in outputs.ports:
                try:
                    event = self._decode(outputs.ports[port])
                except MessageError as exc:
                    text = f"step {outputs.step}: {name}.{port} is {exc}"
                    raise ParticipantFault(text, participant=name, step=outputs.step) from exc
                self._events.take(name, port, outputs.step, event)

    def offer_all(self, name: str, batch: Iterable[Outputs]) -> None:
        """Report the events among several outputs of one participant."""
        if self._ports[name]:
            for outputs in batch:
                self.offer(name, outputs)

    def write_below(self, step: int) -> None:
        """Do nothing."""
