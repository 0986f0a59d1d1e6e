"""Replays one participant against its recording: it is started, all others are played."""

import contextlib
import dataclasses
import threading
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.divergence import PortResult, fields_of, in_order
from stepbus_orchestrator.analysis.tolerance import AnyTolerance, Tolerance, tolerance_of
from stepbus_orchestrator.errors import OutputExists, ParticipantFault
from stepbus_orchestrator.processes.launcher import check_limits
from stepbus_orchestrator.recording import (
    Recorder,
    Recording,
    Sink,
    TimingRecorder,
    layout,
    whole_file,
)
from stepbus_orchestrator.recording.layout import Source
from stepbus_orchestrator.replay.prepare import Prepared, prepare, shorten
from stepbus_orchestrator.replay.recorded import recorded_descriptions
from stepbus_orchestrator.replay.repetition import Repetition
from stepbus_orchestrator.replay.replay_result import ReplayResult, inputs_of
from stepbus_orchestrator.replay.trust import find_source, programs_of
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.extensions.calls import Calls, recorded_calls
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.folder import LOGS_FOLDER, read_files, scratch_folder
from stepbus_orchestrator.run.hosts import Processes
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import at
from stepbus_orchestrator.run.player import Ports
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario, partly_recorded
from stepbus_orchestrator.scenario.override import Overrides, override_texts
from stepbus_orchestrator.scenario.program import replaced_program
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import irregular, make_new_folder
from stepbus_schemas import BridgeFormat, Decoder, MessageError, Outputs

WINDOW = 256
"""How many steps the peers are played ahead of the participant [steps]."""


_decode_outputs = Decoder(Outputs)


class Replayed(Repetition):
    """Counts what one participant publishes otherwise than recorded, beyond a tolerance.

    folder: where it is started; None: in the folder of the scenario. notes: what else differs.

    Raises ParticipantFault for a message that is not of its port's type.
    """

    def __init__(
        self,
        recording: Recording,
        scenario: Scenario,
        participant: str,
        tolerance: Tolerance,
        folder: Path | None = None,
    ) -> None:
        others = (spec.name for spec in scenario.participants if spec.name != participant)
        changed = recording.steps_in(layout.BRANCH_METADATA).get(participant, 0)
        super().__init__(
            recording,
            starts_at=dict.fromkeys(others, FAR),
            counts_from={participant: changed},
            tolerance=tolerance,
        )
        self.spec = scenario.participant(participant)
        self.notes: list[str] = []
        if changed:
            self.notes.append(
                f"the recording is a branch: {participant} was changed at step {changed}, "
                "and is compared from there on"
            )
        self.notes += [
            f"{participant}/{port} is compared where it is recorded (`record: {output.record}`)"
            for port, output in self.spec.outputs.items()
            if output.record_every != 1
        ]
        self._folder = folder
        self._next = changed
        self._newest = b""

    def attach(self, run: RunView) -> None:
        """Give the run the recorded descriptions, and watch the participant."""
        super().attach(run)
        run.descriptions = recorded_descriptions(self.recording)
        # No participant waits for it: only its outputs themselves show how far it has come.
        see = partial(setattr, self, "_newest")
        run.session.bus.subscribe_content(f"out/{self.spec.name}", see)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return where the participant is started."""
        return {} if self._folder is None else {"folder": self._folder}

    def started(self, participant: ParticipantState) -> None:
        """Watch which step the participant publishes: its failures name it."""
        participant.newest = self._newest_step

    def _newest_step(self) -> int:
        try:
            return _decode_outputs(self._newest).step if self._newest else -1
        except MessageError:
            return -1

    def differs(self, name: str, step: int, what: str) -> None:
        """Note a description that has changed; messages are counted."""
        if step < 0:
            self.notes.append(f"{name} {what}")

    def compare_step(self, name: str, step: int, recorded: Ports, own: Ports) -> None:
        """Compare the outputs of the participant at a step."""
        for port, data in own.items():
            try:
                if data != recorded.get(port):
                    self.comparisons[name][port].decode(data)
            except MessageError as exc:
                when = at(step, self._step_ns)
                raise ParticipantFault(
                    f"{when}: {name}.{port} is {exc}", participant=name, step=step
                ) from exc
        super().compare_step(name, step, recorded, own)
        self.run.observer.compared(step, partial(self._beside, recorded, own))
        self._next = step + self.spec.every

    def _beside(self, recorded: Ports, own: Ports) -> list[str]:
        ports = self.comparisons[self.spec.name].items()
        pairs = ((port, one, recorded.get(port), own.get(port)) for port, one in ports)
        return [f"{port}{one.beside(*both)}" for port, one, *both in pairs if any(both)]

    def miss_below(self, end: int) -> None:
        """Count all recorded outputs of steps below `end` that did not come as missing."""
        name, every = self.spec.name, self.spec.every
        for step in range(-(-self._next // every) * every, end, every):
            self.compare_step(name, step, self.outputs.take(name, step), {})

    def results(self) -> list[PortResult]:
        """Return the comparison of each port, by the step of its first divergence."""
        return in_order(one.result() for one in self.comparisons[self.spec.name].values())


def replay(
    recording: Source,
    participant: str,
    *,
    tolerance: AnyTolerance = None,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    update: str | PathLike[str] | None = None,
    window: int = WINDOW,
    recorded: bool = False,
    source: str | PathLike[str] | None = None,
    bridge: BridgeFormat | None = None,
    program: Sequence[str] | None = None,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
    extensions: Sequence[RunExtension] = (),
) -> ReplayResult:
    """Run one participant on its recorded inputs and compare its outputs with the recording.

    Uses the program, files and parameters of the scenario in `source`, otherwise the copy in the
    recording.

    recording: a run.mcap, or the folder of its run. participant: participant to start. tolerance:
    tolerances of the outputs; default: byte-identical. set: override one value of the recorded
    scenario, e.g. controller.params.kp=101. update: write a new reference recording. window: number
    of steps that recorded inputs are sent ahead. recorded: start the copy in the recording, not the
    program of the scenario. source: folder or file of the scenario (default: the file that
    result.json names, or else the current folder). bridge: start the program through `stepbus
    bridge`. program: start this program instead of the recorded one, in the current folder; all
    following arguments belong to it. observer, interrupt, extensions: as in `run`.

    Raises WiringError (ScenarioError) when the recording, participant or tolerance are invalid,
    RunFailure, which quotes the log, when the participant fails.
    """
    opened, tolerance = Recording(recording), tolerance_of(tolerance, participant)
    target, given = (None if path is None else Path(path) for path in (update, source))
    tolerance.check(
        {topic: fields_of(port.type, opened.types) for topic, port in opened.ports.items()}
    )
    check_limits(1)
    is_copy = recorded or program is not None
    file = None if is_copy else find_source(opened, given)
    with scratch_folder("replay") as folder:
        prepared = prepare(
            opened,
            participant,
            folder / "source",
            override_texts(set),
            own_program=program is not None,
            source=file,
        )
        scenario = shorten(prepared.scenario, opened, participant, window)
        for extension in extensions:
            scenario = extension.prepare(scenario)
        specs = [
            replaced_program(spec, program or (), bridge) if spec.name == participant else spec
            for spec in scenario.participants
        ]
        started = dataclasses.replace(scenario, participants=tuple(specs))
        start_folder = None if program is None else Path.cwd()
        replayed = Replayed(opened, scenario, participant, tolerance, start_folder)
        with _new_reference(target, opened, prepared) as sink:
            run = _run(
                started, replayed, sink, folder, extensions, observer=observer, interrupt=interrupt
            )
    state = run.state
    # From here on, nothing is expected of the participant.
    end = scenario.steps or 0
    if not any(item.is_stopping for item in extensions if isinstance(item, Pace)):
        replayed.miss_below(end + Schedule(scenario).closing(participant, end))
    if state.end is not None and state.end[0] < end:
        replayed.notes.append(f"the run ended after step {state.end[0] - 1}: {state.end[1]}")
    ports = replayed.results()
    divergence = ports[0].divergence if ports else None
    here = Path.cwd()
    notes = [f"the recording {flaw}" for flaw in opened.flaws()] + replayed.notes
    if not is_copy and file is None and programs_of(opened, participant).files:
        # The user may be working on another one.
        notes.append(
            "testing the copy in the recording, as its scenario is not in the current folder; give "
            "its folder with --source, or choose the copy with --recorded"
        )
    return ReplayResult(
        recording=str(opened.path),
        participant=participant,
        equal=divergence is None,
        steps=state.steps,
        divergence=divergence,
        inputs=inputs_of(opened, scenario, participant, divergence.step) if divergence else {},
        ports=ports,
        wall_s=run.ended_at - state.started_at,
        updated=None if target is None else str(target),
        source=""
        if file is None
        else str(file.relative_to(here) if file.is_relative_to(here) else file),
        changes=prepared.notes,
        notes=notes,
        code=prepared.code,
    )


def _run(
    scenario: Scenario,
    replayed: Replayed,
    sink: Sink,
    folder: Path,
    extensions: Sequence[RunExtension],
    *,
    observer: Observer | None,
    interrupt: threading.Event | None,
) -> Run:
    """Run one participant, and return the run once it has ended, whatever happens.

    folder: gets the participant's log.
    """
    name, recording = replayed.spec.name, replayed.recording
    host = Processes(start_order=[name], is_star=True)
    run = Run(
        scenario,
        sink,
        TimingRecorder(None, host.clock),
        out=folder,
        observer=observer,
        interrupt=interrupt,
        extensions=[*extensions, replayed, Calls(recorded_calls(recording, name))],
    )
    make_new_folder(folder / LOGS_FOLDER)
    run.take_place(host)
    return run


@contextlib.contextmanager
def _new_reference(target: Path | None, old: Recording, prepared: Prepared) -> Iterator[Sink]:
    """Yield what takes the outputs; the file gets its name at the end, if nothing has failed.

    target: must not exist; None: nothing is written. prepared: what is attached: its scenario, and
    its files of the work tree, or else those of the old recording. Raises RecordingFailed when it
    exists or cannot be written.
    """
    scenario = prepared.scenario
    order = [scenario.participant(name) for name in Schedule(scenario).order]
    if target is None:
        yield Sink({spec.name: spec.outputs for spec in order}, partly_recorded(order))
        return
    if irregular(target) or target.exists():
        raise OutputExists(f"{target} already exists; choose another name with --update")
    text, contents = old.attachments[layout.SCENARIO_ATTACHMENT], layout.files_of(old.attachments)
    if prepared.is_changed:
        text = resolved(scenario).encode()
    if prepared.files is not None:
        contents = read_files(prepared.files)
    versions = layout.versions_of(old.metadata)
    own = {layout.versions_metadata(spec.name) for spec in order}
    with whole_file(target) as file:
        file.attach_scenario(text, contents)
        for name, metadata in old.metadata.items():
            if name not in own:
                file.add_metadata(name, metadata)
        yield Recorder(file, order, scenario.step_ns, types=scenario.types, versions=versions)
