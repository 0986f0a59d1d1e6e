"""The strategy of a replay: one participant is started, its peers are played."""

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.divergence import fields_of, in_order
from stepbus_orchestrator.analysis.tolerance import AnyTolerance, tolerance_of
from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.processes.endpoints import (
    Mesh,
    make_mesh,
    new_token,
    private_folder,
)
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.processes.limits import check_limits
from stepbus_orchestrator.recording import Descriptions, Recorder, Recording, TimingRecorder, layout
from stepbus_orchestrator.recording.layout import Source
from stepbus_orchestrator.replay.check import Check, new_reference
from stepbus_orchestrator.replay.peers import Peer, Peers
from stepbus_orchestrator.replay.prepare import alone, prepare, shorten
from stepbus_orchestrator.replay.recorded import Recorded, recorded_descriptions
from stepbus_orchestrator.replay.replay_result import ReplayResult, inputs_of
from stepbus_orchestrator.replay.trust import programs_of
from stepbus_orchestrator.replay.work_tree import find_work_tree
from stepbus_orchestrator.run.bus import Session, open_bus
from stepbus_orchestrator.run.extensions.calls import Calls, recorded_calls
from stepbus_orchestrator.run.folder import scratch_folder
from stepbus_orchestrator.run.kernel.participants import Participants, ParticipantState, Process
from stepbus_orchestrator.run.phases import run_phases
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario import (
    Overrides,
    ParticipantSpec,
    Scenario,
    Schedule,
    override_texts,
    replaced_program,
    start_command,
)
from stepbus_participant import Bus, make_new_folder
from stepbus_schemas import BridgeFormat, Decoder, MessageError, Outputs

_decode_outputs = Decoder(Outputs)


class Replay:
    """Starts one participant, and plays the others from a recording.

    start: starts its process. recorded: the descriptions of all outputs. mesh: of the replay.
    """

    def __init__(
        self,
        spec: ParticipantSpec,
        start: Callable[[], Process],
        peers: Peers,
        recorded: Descriptions,
        *,
        bus: Bus,
        mesh: Mesh,
    ) -> None:
        self.peers = peers
        self.mesh = mesh
        self._spec = spec
        self._start = start
        self._recorded = recorded
        self._bus = bus
        self._newest: Any = None
        # Nobody waits for it, so that only its outputs themselves show how far it has come.
        bus.subscribe(f"out/{spec.name}", self._see)

    def _see(self, sample: Any) -> None:
        self._newest = sample

    def newest_step(self) -> int:
        """Return the newest step the participant was seen to publish; −1 before the first."""
        try:
            return _decode_outputs(self._bus.payload(self._newest)).step if self._newest else -1
        except MessageError:
            return -1

    def launch(self, run: Run) -> None:
        """Start the participant."""
        run.started(ParticipantState(self._spec, self._start(), self.newest_step))

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how all outputs were described when they were recorded."""
        return self._recorded


WINDOW = 256
"""How many steps the peers are played ahead of the participant [steps]."""


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
    trusted: str | None = None,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> ReplayResult:
    """Run one participant against its recording, and compare what it publishes.

    Its program, files and parameters are those of the work tree, where that has the scenario
    (`find_work_tree`), else the copy in the recording.

    recording: the run.mcap of a run, or its folder. participant: participant to start. tolerance:
    how far outputs may differ; default: equal to the byte. set: override one value of the recorded
    scenario, e.g. controller.params.kp=101. update: write a new reference recording. window: how
    many steps its peers are played ahead of it. recorded: start the copy in the recording, not the
    program in the work tree. source: folder or file of the scenario in the work tree (default: it
    is searched). bridge: start the program through `stepbus bridge`. program: start this program
    instead of the recorded one, in the current folder; everything after it is its command line.
    trusted: fingerprint of the programs that may be started (`rerun.fingerprint`); None: any.
    observer, interrupt: as of `run`.

    Raises WiringError (ScenarioError) when the recording, participant or tolerance do not fit,
    RunFailure when the participant fails; it quotes its log.
    """
    opened, tolerance = Recording(recording), tolerance_of(tolerance, participant)
    target, tree_path = (None if path is None else Path(path) for path in (update, source))
    tolerance.check(
        {topic: fields_of(port.type, opened.types) for topic, port in opened.ports.items()}
    )
    check_limits(1)
    is_copy = recorded or program is not None
    tree = None if is_copy else find_work_tree(opened, participant, tree_path)
    with scratch_folder("replay") as folder:
        prepared = prepare(
            opened,
            participant,
            folder / "source",
            override_texts(set),
            own_program=program is not None,
            tree=tree,
            trusted=trusted,
        )
        scenario = shorten(prepared.scenario, opened, participant, window)
        with new_reference(target, opened, prepared) as reference:
            check = Check(
                opened,
                scenario.participant(participant),
                tolerance,
                step_ns=scenario.step_ns,
                reference=reference,
            )
            run = _Replay(opened, participant, program, bridge, folder, observer, interrupt)
            wall_s, steps = run.execute(scenario, check, reference)
    divergence = check.divergence
    copied = [] if is_copy or tree is not None else _copy_notes(opened, participant)
    return ReplayResult(
        recording=str(opened.path),
        participant=participant,
        equal=divergence is None,
        steps=steps,
        divergence=divergence,
        inputs=inputs_of(opened, scenario, participant, divergence.step) if divergence else {},
        ports=in_order(check.results()),
        wall_s=wall_s,
        updated=None if target is None else str(target),
        source="" if tree is None else tree.shown(),
        changes=prepared.notes,
        notes=[*(f"the recording {flaw}" for flaw in opened.flaws()), *check.notes, *copied],
    )


def _copy_notes(recording: Recording, participant: str) -> list[str]:
    """Return a sentence where the copy is tested of a program that somebody may be working on."""
    if not programs_of(recording, participant).files:
        return []
    note = (
        "this tests the copy in the recording: its scenario was not found in the work tree; "
        f"name its folder with {argument('--source')}, or mean the copy with "
        f"{argument('--recorded')}"
    )
    return [note]


@dataclass
class _Replay:
    """One replay. folder: gets the unpacked scenario and the participant's log."""

    recording: Recording
    participant: str
    program: Sequence[str] | None
    bridge: BridgeFormat | None
    folder: Path
    observer: Observer | None
    interrupt: threading.Event | None
    token: str = field(default_factory=new_token)

    def execute(
        self, scenario: Scenario, check: Check, reference: Recorder | None
    ) -> tuple[float, int]:
        """Return how long it took [s], and how many steps it were; close whatever happens."""
        run, folder, logs = new_token(), private_folder(), self.folder / "logs"
        spec = scenario.participant(self.participant)
        with contextlib.ExitStack() as stack:
            launcher = Launcher(run=run, token=self.token, folder=folder, logs=logs)
            stack.callback(launcher.end_all)
            make_new_folder(logs)
            timing = TimingRecorder(self.folder / layout.TIMING_FILE, time)
            stack.callback(timing.close)
            mesh = make_mesh(alone(scenario, spec.name), folder, run)
            bus = open_bus(mesh.orchestrator, run)
            stack.callback(bus.close)
            session = Session(scenario, bus, self.token, spec.deadlines.step_s)
            stack.callback(session.announcer.close)
            start = partial(self._start, launcher, mesh, spec, scenario.folder)
            strategy = self._strategy(session, spec, start, reference, mesh)
            loop = Run(
                session,
                strategy,
                check,
                timing,
                out=self.folder,
                observer=self.observer,
                interrupt=self.interrupt,
                extensions=[Calls(recorded_calls(self.recording, spec.name))],
            )
            run_phases(loop)
        # From here on, nothing is expected of the participant.
        end = scenario.steps or 0
        check.miss_below(end + Schedule.of(scenario).closing(spec.name, end))
        return loop.ended_at - loop.state.started_at, loop.state.steps

    def _strategy(
        self,
        session: Session,
        spec: ParticipantSpec,
        start: Callable[[], Process],
        reference: Recorder | None,
        mesh: Mesh,
    ) -> Replay:
        sources = {item.source for item in spec.inputs.values()}
        peers = Peers(
            [
                Peer(
                    other,
                    Recorded(self.recording, other),
                    session.announcer,
                    is_read=other.name in sources,
                )
                for other in session.scenario.participants
                if other.name != spec.name
            ],
            token=self.token,
            step_ns=session.scenario.step_ns,
            take=None if reference is None else reference.offer,
        )
        recorded = recorded_descriptions(self.recording)
        return Replay(spec, start, peers, recorded, bus=session.bus, mesh=mesh)

    def _start(
        self, launcher: Launcher, mesh: Mesh, spec: ParticipantSpec, folder: Path
    ) -> Process:
        own_folder = folder if self.program is None else Path.cwd()
        started = replaced_program(spec, self.program or (), self.bridge)
        argv = start_command(started, own_folder)
        return launcher.start(spec, argv, mesh.participants[spec.name], own_folder)
