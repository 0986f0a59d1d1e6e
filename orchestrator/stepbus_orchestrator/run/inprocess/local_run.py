"""The strategy of a run in one process: every participant is hosted here."""

import contextlib
import math
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from stepbus_orchestrator.errors import StartFailed, argument
from stepbus_orchestrator.processes.child import BoundedLog
from stepbus_orchestrator.processes.endpoints import private_folder
from stepbus_orchestrator.processes.reaping import Reaper
from stepbus_orchestrator.processes.turns import MOST, Row, Turns, Word
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.extensions.hosted_caller import HostedCaller, Room, Seat
from stepbus_orchestrator.run.host import NoPeers, Opening, ready_descriptions
from stepbus_orchestrator.run.inprocess.participant import HostedBus, HostedParticipant
from stepbus_orchestrator.run.inprocess.program import ScenarioModules, check_programs, program_of
from stepbus_orchestrator.run.kernel.participants import Participants, ParticipantState, Phase
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario import (
    PROCESS_FAULTS,
    ParticipantSpec,
    Scenario,
    faults_of,
    format_fault,
)
from stepbus_participant import Endpoint, LoopbackBus, Ticket
from stepbus_schemas import WiringError

from .guard import Belongings, Guard
from .hub import Hub
from .surroundings import NATIVE_LOG, Surroundings
from .watch import Watch, traced, watched_from_outside


def check_scenario(scenario: Scenario) -> None:
    """Raise WiringError for a scenario that cannot run in one process, with every reason."""
    external = [spec.name for spec in scenario.participants if spec.is_external]
    if external:
        raise WiringError(
            f"{', '.join(external)}: a participant that somebody else starts has a process of its "
            f"own; leave out {argument('--in-process')}"
        )
    faults = faults_of(scenario.faults, PROCESS_FAULTS)
    if faults:
        texts = ", ".join(f"'{format_fault(fault)}'" for fault in faults)
        raise WiringError(
            f"{texts}: a fault of a process needs one; leave out {argument('--in-process')}"
        )
    check_programs(scenario)


class LocalRun:
    """Hosts all participants in this process; none is played.

    modules: of the scenario's folder. start_order: names, in the order in which they begin.

    bus: the orchestrator's, whose network the participants join. guard: keeps what one does to
    this process from the others.
    """

    mesh = None
    """They need no endpoints."""

    def __init__(
        self, opening: Opening, modules: ScenarioModules, start_order: Sequence[str] | None
    ) -> None:
        self.peers = NoPeers()
        self.hub = Hub()
        self.hub.before = self._before
        self.bus = LoopbackBus(make_queue=self.hub.queue)
        self.hosted: dict[str, HostedParticipant] = {}
        self._opening = opening
        self._logs = opening.logs
        self._start_order = start_order
        callers = (item for item in opening.extensions if isinstance(item, HostedCaller))
        self._seat = next((item.seat for item in callers), None)
        self._modules = modules
        self.guard = Guard(self._running, self._belongings)
        self._pid = os.getpid()
        self._state: RunState | None = None
        self._turns: Turns
        self._reaper: Reaper | None = None

    @contextlib.contextmanager
    def watched(self, around: Surroundings) -> Iterator[None]:
        """Watch the participants' deadlines; end all that are left.

        around: what they find around them, which is put back while whoever has a seat works.
        """
        with contextlib.ExitStack() as stack:
            self._turns = stack.enter_context(watched_from_outside())
            logs = [BoundedLog(self._logs / NATIVE_LOG)]
            watch = Watch(
                self._current, self._limit_s, self._opening.interrupt.is_set, self._turns, logs
            )
            stack.callback(watch.close)
            stack.enter_context(traced(self._turns))
            stack.callback(self._end_all)
            if self._seat is not None:
                self._offer(self._seat, around)
            yield

    def _end_all(self) -> None:
        for hosted in self.hosted.values():
            hosted.end()
        if self._reaper is not None:
            self._reaper.end()
        for hosted in self.hosted.values():
            if hosted.belongings.has_threads():
                self._turns.words[Word.LEFT] = hosted.number

    def _running(self) -> Belongings | None:
        """Return what the participant has whose code runs now."""
        running = (hosted for hosted in self.hosted.values() if hosted.is_running())
        return next((hosted.belongings for hosted in running), None)

    def _belongings(self) -> list[Belongings]:
        return [hosted.belongings for hosted in self.hosted.values()]

    def _offer(self, seat: Seat, around: Surroundings) -> None:
        """Let a participant of our caller take part."""

        def enter(away_s: float) -> None:
            around.enter()
            if self._state is not None:
                self._state.away_s += away_s

        def ask_end(step: int, reason: str) -> None:
            if self._state is not None:
                self._state.ask_end(step, reason)

        seat.sit(Room(queue=self.hub.queue, ask_end=ask_end, leave=around.leave, enter=enter))
        self.hub.away = seat.away

    def _take_program(self, group: int) -> None:
        """Let a program that a participant has started not outlive us."""
        if self._reaper is None:
            self._reaper = Reaper(private_folder())
        self._reaper.watch(group)

    def _current(self) -> tuple[HostedParticipant, int] | None:
        for hosted in self.hosted.values():
            if hosted.has_thread():
                return hosted, int(self._turns.words[Row.PUBLISHED + hosted.number])
        return None

    def _limit_s(self, name: str) -> float:
        return self._limit(name)[0]

    def _limit(self, name: str) -> tuple[float, int]:
        """Return how long a participant may keep the thread [s], and by which of `DEADLINES`."""
        if self._state is None:
            return math.inf, 0
        participant = self._state.participants[name]
        deadlines = participant.spec.deadlines
        if self._state.phase.is_stopping:
            return deadlines.stop_s, 2
        if participant.phase < Phase.READY:
            return deadlines.spawn_s + deadlines.join_s + deadlines.ready_s, 0
        return deadlines.step_s, 1

    def _before(self) -> None:
        """Note what the participants may take, since the orchestrator has had the thread."""
        if os.getpid() != self._pid:
            # A library in C has forked: this is a second orchestrator, with the same open files.
            os.kill(os.getpid(), signal.SIGKILL)
        for hosted in self.hosted.values():
            self._turns.limit(hosted.number, *self._limit(hosted.name))

    def launch(self, run: Run) -> None:
        """Let the participants begin, in the order of the options."""
        scenario = run.state.scenario
        self._state = run.state
        self._turns.write(
            {
                "result": self._opening.result().decode(),
                "names": [spec.name for spec in scenario.participants],
                "every": [spec.every for spec in scenario.participants],
                "logs": str(self._logs),
                "path": sys.path,
            }
        )
        for name in self._start_order or [s.name for s in scenario.participants]:
            spec = scenario.participant(name)
            hosted = self._host(spec, scenario, run.extensions.start_options(spec))
            self.hosted[name] = hosted
            run.started(ParticipantState(spec, hosted))
            run.timing.event("spawn", name, f"in process {hosted.pid}")

    def _host(
        self, spec: ParticipantSpec, scenario: Scenario, options: dict[str, Any]
    ) -> HostedParticipant:
        has_terminal = options.pop("has_terminal", False)
        names = [item.name for item in scenario.participants]
        number = min(1 + names.index(spec.name), MOST - 1)
        ticket = Ticket(
            run=self._opening.run,
            name=spec.name,
            token=self._opening.token,
            endpoint=Endpoint(listen=[], connect=["this process"]),
            join_timeout_s=spec.deadlines.join_s,
            **options,
        )
        try:
            return HostedParticipant(
                ticket,
                HostedBus(
                    self.bus,
                    spec.name,
                    counter=(self._turns.words, Row.PUBLISHED + number),
                    is_leaf=self._opening.is_star,
                ),
                program_of(spec, scenario.folder, self._seat),
                modules=self._modules,
                hub=self.hub,
                log=self._logs / f"{spec.name}.log",
                take_program=self._take_program,
                shown=has_terminal,
                number=number,
                turns=self._turns,
            )
        except OSError as exc:
            raise StartFailed(
                f"{spec.name} could not be started: its log: {exc.strerror}", participant=spec.name
            ) from exc

    def descriptions(self, participants: Participants) -> Descriptions:
        """Return how the participants describe their outputs."""
        return ready_descriptions(participants)
