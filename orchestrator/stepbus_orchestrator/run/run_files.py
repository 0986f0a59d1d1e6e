"""What a run writes, run.mcap and timing.mcap, and what stands in for them in one that does not."""

from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path

from stepbus_orchestrator.errors import ParticipantFault, RecordingFailed, RunFailure, argument
from stepbus_orchestrator.recording import McapFile, Recorder, Sink, TimingRecorder, layout
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.folder import attach
from stepbus_orchestrator.run.host import Host
from stepbus_orchestrator.run.reports import Events
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import is_shared
from stepbus_schemas import Decoder, Event, MessageError, Outputs, type_name

_EVENT = type_name(Event)


class NoRecorder(Sink):
    """A sink that keeps nothing; events are reported all the same.

    order: the participants. on_event: gets every Event.
    """

    messages_sha256 = ""
    silent: Collection[tuple[str, str]] = frozenset()

    def __init__(
        self,
        order: Sequence[ParticipantSpec],
        on_event: Callable[[str, str, int, Event], None],
    ) -> None:
        super().__init__(order)
        self._on_event = on_event
        self._events = {
            spec.name: [port for port, row in spec.outputs.items() if row.type == _EVENT]
            for spec in order
        }
        self._decode = Decoder(Event)

    def offer(self, name: str, outputs: Outputs) -> None:
        """Report the events among the outputs of one participant."""
        for port in self._events[name]:
            if port in outputs.ports:
                self._on_event(name, port, outputs.step, self._event(name, port, outputs))

    def _event(self, name: str, port: str, outputs: Outputs) -> Event:
        try:
            return self._decode(outputs.ports[port])
        except MessageError as exc:
            text = f"step {outputs.step}: {name}.{port} is {exc}"
            raise ParticipantFault(text, participant=name, step=outputs.step) from exc

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Do nothing."""

    def write_below(self, step: int) -> None:
        """Do nothing."""


class NoTiming(TimingRecorder):
    """Records no times."""

    def __init__(self) -> None:
        """Open no file."""

    def event(self, event: str, participant: str = "", text: str = "") -> None:
        """Do nothing."""

    def steps(self, participant: str, rows: list[tuple[int, int, int]]) -> None:
        """Do nothing."""

    def trigger(self, step_limit: int) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


_SHARED = (
    "{folder} may be written by every user of this machine, who could put files of theirs in the "
    "place of the run's; choose another {out}, or take that right away: chmod o-w {folder}"
)


class RunFiles:
    """The files of a run in its folder `out`, which nobody else may be using.

    recorder: gets the outputs of the participants. timing: gets what the clock shows.
    """

    def __init__(
        self, scenario: Scenario, out: Path, events: Events, host: Host, *, is_recorded: bool
    ) -> None:
        self._scenario = scenario
        self._events = events
        # A run in one process works in the scenario's folder.
        self.out = out.resolve()
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        self._file: McapFile | None = None
        self.timing: TimingRecorder = NoTiming()
        self.recorder: Recorder | NoRecorder = NoRecorder(order, events.take)
        if is_recorded:
            self._file = McapFile(self.out / layout.RUN_FILE, host.disk)
            timing = self.out / layout.TIMING_FILE
            self.timing = TimingRecorder(timing, host.clock, host.disk)
            self.recorder = Recorder(
                self._file, order, scenario.step_ns, events.take, scenario.types
            )
        if is_shared(self.out):
            events.add_warning("orchestrator", _SHARED.format(folder=out, out=argument("--out")))

    def describe(self, extensions: Iterable[RunExtension]) -> None:
        """Record what the run starts from; warn where a rerun would not find all of it."""
        if self._file is None:
            return
        attach(self._file, self._scenario)
        for extension in extensions:
            for name, content in extension.metadata().items():
                self._file.add_metadata(name, content)

    def warn_of_rerun(self) -> None:
        """Warn where a rerun would not find what the run started from."""
        if self._file is not None:
            for what in self._scenario.left_out:
                self._events.add_warning("recording", f"a rerun does not find {what}")

    def close(
        self, reason: str, failure: RunFailure | None, *, is_recorded: bool
    ) -> str | RunFailure:
        """Write what has arrived of a run that failed; check the file of one that finished.

        reason: why it ended. is_recorded: whether all of it is written. Return why it ended, or
        what it failed from.
        """
        try:
            if not is_recorded:
                self.recorder.abort()
            if failure is None and self._file is not None:
                self._file.check()
        except RunFailure as exc:
            failure = failure or exc
        self.timing.event("end", text=str(failure or reason))
        self.timing.close()
        return failure or reason

    def translated(self, exc: OSError) -> RunFailure:
        """Return the failure for what nobody expected of a file, by the folder it is in."""
        error = RecordingFailed if str(exc.filename).startswith(str(self.out)) else RunFailure
        return error(f"{exc.filename or 'this machine'}: {exc.strerror or exc}")
