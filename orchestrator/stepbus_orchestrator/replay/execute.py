"""Replays one participant: the function behind `stepbus replay`, free of printing."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from stepbus_orchestrator.analysis.comparison import Tolerance, fields_of, in_order
from stepbus_orchestrator.errors import BusFailed
from stepbus_orchestrator.processes import (
    Launcher,
    Mesh,
    check_open_files,
    make_mesh,
    new_token,
    private_folder,
)
from stepbus_orchestrator.recording import Recording, TimingRecorder, layout
from stepbus_orchestrator.run.bus.session import Session
from stepbus_orchestrator.run.control.calls import recorded_calls
from stepbus_orchestrator.run.kernel.participants import Process
from stepbus_orchestrator.run.loop import Controls, Records, RunLoop
from stepbus_orchestrator.run.phases import run_phases
from stepbus_orchestrator.run.progress import Observer, Silent
from stepbus_orchestrator.scenario import Scenario, Schedule, command, start_command
from stepbus_participant import BusError, ZenohBus

from .check import Check, recorded_descriptions
from .inputs import inputs_of
from .peers import Peer, Peers
from .prepare import alone, prepare, shorten
from .recorded import Recorded
from .reference import Reference
from .result import ReplayResult
from .strategy import Replay

WINDOW = 256
"""How many steps the peers are played ahead of the participant [steps]."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """What is to be replayed, and how.

    program: another program than the recorded one, started in the current folder. overrides:
    settings such as `controller.params.kp=101`. update: where to write a new reference recording.
    """

    recording: Recording
    participant: str
    program: Sequence[str] | None = None
    overrides: Sequence[str] = ()
    tolerance: Tolerance = field(default_factory=Tolerance)
    update: Path | None = None
    window: int = WINDOW


def replay(
    recording: Path,
    participant: str,
    *,
    program: Sequence[str] | None = None,
    overrides: Sequence[str] = (),
    tolerance: Tolerance | None = None,
    update: Path | None = None,
    window: int = WINDOW,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> ReplayResult:
    """Start one participant of a recording, feed it what its peers sent, and compare.

    All arguments but the first two as in `Task`; observer, interrupt: as of `run`.

    Raises WiringError (ScenarioError) when the recording, participant or tolerance do not fit,
    RunFailure when the participant fails; then its log is kept.
    """
    task = Task(
        recording=Recording(recording),
        participant=participant,
        program=program,
        overrides=overrides,
        tolerance=tolerance or Tolerance(),
        update=update,
        window=window,
    )
    task.tolerance.check({t: fields_of(port.type) for t, port in task.recording.ports.items()})
    check_open_files(1)
    folder = Path(tempfile.mkdtemp(prefix="replay-stepbus-"))
    run = _Replay(task, folder, observer or Silent(), interrupt or threading.Event())
    try:
        return run.execute()
    finally:
        if not run.keeps_log:
            shutil.rmtree(folder)


class _Replay:
    """One replay. folder: gets the unpacked scenario and the participant's log.

    keeps_log: whether the participant was started and has not ended well.
    """

    def __init__(
        self, task: Task, folder: Path, observer: Observer, interrupt: threading.Event
    ) -> None:
        self.keeps_log = False
        self._task = task
        self._folder = folder
        self._observer = observer
        self._interrupt = interrupt
        self._token = new_token()

    def _make_reference(self, scenario: Scenario) -> Reference | None:
        task = self._task
        if task.update is None:
            return None
        changed = bool(task.overrides)
        return Reference(task.update, task.recording, scenario, is_changed=changed)

    def execute(self) -> ReplayResult:
        """Replay, close whatever happens, and return the result."""
        task = self._task
        full = prepare(
            task.recording,
            task.participant,
            self._folder / "source",
            task.overrides,
            own_program=task.program is not None,
        )
        spec = self._spec = full.participant(task.participant)
        self._scenario = shorten(full, task.recording, task.participant, task.window)
        reference = self._reference = self._make_reference(full)
        check = Check(
            task.recording,
            spec,
            task.tolerance,
            step_ns=self._scenario.step_ns,
            reference=None if reference is None else reference.recorder,
        )
        try:
            wall_s, steps = self._with_processes(check)
            if reference is not None:
                reference.keep()
        finally:
            if reference is not None:
                reference.discard()
        return self._result(check, wall_s, steps)

    def _with_processes(self, check: Check) -> tuple[float, int]:
        """Return how long it took [s], and how many steps it were."""
        run, folder, logs = new_token(), private_folder(), self._folder / "logs"
        with contextlib.ExitStack() as stack:
            launcher = Launcher(run=run, token=self._token, folder=folder, logs=logs)
            stack.callback(launcher.end_all)
            logs.mkdir()
            timing = TimingRecorder(self._folder / layout.TIMING_FILE)
            stack.callback(timing.close)
            mesh = make_mesh(alone(self._scenario, self._spec.name), folder, run)
            bus = _open_bus(mesh, run)
            stack.callback(bus.close)
            limit_s = self._spec.deadlines.step_s
            session = Session(self._scenario, bus, self._token, limit_s)
            stack.callback(session.announcer.close)
            loop = RunLoop(
                session,
                self._strategy(session, partial(self._start, launcher, mesh)),
                Records(recorder=check, timing=timing),
                Controls(
                    observer=self._observer,
                    interrupt=self._interrupt,
                    calls=recorded_calls(self._task.recording, self._spec.name),
                ),
            )
            self.keeps_log = True
            run_phases(loop)
            self.keeps_log = False
        check.miss_below(self._expected_end())
        return loop.ended_at - loop.state.started_at, loop.state.steps

    def _strategy(self, session: Session, start: Callable[[], Process]) -> Replay:
        recording, scenario = self._task.recording, self._scenario
        sources = {item.source for item in self._spec.inputs.values()}
        others = [spec for spec in scenario.participants if spec.name != self._spec.name]
        reference = self._reference
        peers = Peers(
            [
                Peer(
                    spec, Recorded(recording, spec), session.announcer, is_read=spec.name in sources
                )
                for spec in others
            ],
            token=self._token,
            step_ns=scenario.step_ns,
            take=None if reference is None else reference.recorder.offer,
        )
        return Replay(self._spec, start, peers, recorded_descriptions(recording), session.bus)

    def _start(self, launcher: Launcher, mesh: Mesh) -> Process:
        spec, program = self._spec, self._task.program
        own_folder = self._scenario.folder if program is None else Path.cwd()
        argv = command(program, own_folder) if program else start_command(spec, own_folder)
        return launcher.start(spec, argv, mesh.participants[spec.name], own_folder)

    def _expected_end(self) -> int:
        """Return the first step at which nothing is expected of the participant."""
        end = self._scenario.steps or 0
        return end + Schedule.of(self._scenario).closing(self._spec.name, end)

    def _result(self, check: Check, wall_s: float, steps: int) -> ReplayResult:
        task, found = self._task, check.divergence
        inputs = {}
        if found is not None:
            inputs = inputs_of(task.recording, self._scenario, self._spec, found.step)
        return ReplayResult(
            recording=str(task.recording.path),
            participant=task.participant,
            equal=found is None,
            steps=steps,
            divergence=found,
            inputs=inputs,
            ports=in_order(check.results()),
            wall_s=wall_s,
            updated=None if task.update is None else str(task.update),
            notes=[*_damage(task.recording), *check.notes],
        )


def _open_bus(mesh: Mesh, run: str) -> ZenohBus:
    try:
        return ZenohBus(mesh.orchestrator, run)
    except BusError as exc:
        raise BusFailed(str(exc)) from exc


def _damage(recording: Recording) -> list[str]:
    return [f"the recording {flaw}" for flaw in recording.flaws()]
