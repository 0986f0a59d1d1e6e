"""The files of a run: opened before it starts, and closed whatever happens."""

import contextlib
import os
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from stepbus_orchestrator.errors import ParticipantFault, RecordingFailed, RunFailure
from stepbus_orchestrator.recording import McapFile, Recorder, Sink, TimingRecorder, layout
from stepbus_orchestrator.run.extension import Host, RunExtension
from stepbus_orchestrator.run.folder import HEAD_BYTES, LOGS_FOLDER, claim, read_files, warnings_in
from stepbus_orchestrator.run.reports import Events, Observer
from stepbus_orchestrator.run.result import Result, own_versions
from stepbus_orchestrator.scenario.fault_texts import format_fault
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import is_shared
from stepbus_schemas import Decoder, Event, MessageError, Outputs, type_name

_SHARED = (
    "{folder} is writable by every user of this machine, who could replace the run's "
    "files; choose another --out, or remove that permission: chmod o-w {folder}"
)


class RunFiles:
    """The files of a run in its folder.

    scenario: is recorded. folder: is made, must be empty. is_recorded: whether anything but logs
    is written. out: the absolute path of the folder. recorder: gets the outputs. timing: gets what
    the clock shows. events: that were reported. opened_at: by the monotonic clock [s].

    Raises RecordingFailed when they cannot be written.
    """

    def __init__(
        self, scenario: Scenario, folder: Path, host: Host, observer: Observer, *, is_recorded: bool
    ) -> None:
        self.opened_at = host.clock.monotonic()
        claim(folder)
        self.scenario, self.folder = scenario, folder
        # A run in one process works in the scenario's folder.
        self.out = folder.resolve()
        self.events = Events(observer)
        self._host = host
        self._observer = observer
        self._file: McapFile | None = None
        order = [scenario.participant(name) for name in Schedule(scenario).order]
        self.recorder: Recorder | _NoRecorder = _NoRecorder(order, self.events)
        timing = None
        if is_recorded:
            # A simulated disk knows no threads.
            path, is_real = self.out / layout.RUN_FILE, host.disk is os
            self._file = McapFile(path, host.disk, in_background=is_real)
            self.recorder = Recorder(
                self._file, order, scenario.step_ns, self.events.take, scenario.types
            )
            timing = self.out / layout.TIMING_FILE
        self.timing = TimingRecorder(timing, host.clock, host.disk)
        if is_shared(self.out):
            self.events.add_warning("orchestrator", _SHARED.format(folder=folder))

    def describe(self) -> None:
        """Record all that is needed to run again; raises RecordingFailed."""
        if self._file is None:
            return
        text, contents = resolved(self.scenario).encode(), read_files(self.scenario.files)
        self._file.attach_scenario(text, contents)
        self._file.add_metadata(layout.ENVIRONMENT_METADATA, own_versions())
        faults = enumerate(map(format_fault, self.scenario.faults))
        if rows := {f"{number:04}": text for number, text in faults}:
            self._file.add_metadata(layout.FAULTS_METADATA, rows)

    def close(self, ending: str | RunFailure, *, is_finished: bool, steps: int) -> str | RunFailure:
        """Write what has arrived of a run that failed; check the file of one that finished.

        ending: why the run ended, or what it failed from. is_finished: whether the recording is
        complete. steps: that the run made. Return why it ended, also where the recording failed.
        """
        failure = ending if isinstance(ending, RunFailure) else None
        try:
            if not is_finished:
                self.recorder.abort()
            if failure is None and self._file is not None:
                self._file.check()
        except RunFailure as exc:
            failure = failure or exc
        self.timing.event("end", text=str(failure or ending))
        self.timing.close()
        has_ended = is_finished and failure is None
        if has_ended:
            for what in self.scenario.left_out:
                self.events.add_warning("recording", f"a rerun does not find {what}")
        for spec in self.scenario.participants:
            log = self.out / LOGS_FOLDER / f"{spec.name}.log"
            with contextlib.suppress(OSError), log.open("rb") as file:
                for text in warnings_in(file.read(HEAD_BYTES)):
                    self.events.add_warning(spec.name, text)
        if has_ended:
            self.events.add_silent(self.scenario, self.recorder.silent, steps)
        return failure or ending

    def save(self, result: Result, extensions: Sequence[RunExtension]) -> None:
        """Write result.json, and what extensions make of the result; report where that fails."""
        try:
            result.save(self._host.disk)
        except OSError as exc:
            self._observer.event("error", "orchestrator", result.steps, f"result.json: {exc}")
        for extension in extensions:
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
