"""A run in one process: which scenarios may have one, and the strategy that hosts them."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.run.extension import RunView, Strategy
from stepbus_orchestrator.run.folder import LOGS_FOLDER
from stepbus_orchestrator.run.inprocess.heartbeat import MOST, PUBLISHED, STAGE, Heartbeat, Stage
from stepbus_orchestrator.run.inprocess.hub import HostedParticipant, Hub
from stepbus_orchestrator.run.inprocess.surroundings import NATIVE_LOG, Surroundings
from stepbus_orchestrator.run.inprocess.watch import watched
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import RunPhase, RunState
from stepbus_orchestrator.scenario.fault_texts import PROCESS_FAULTS, faults_of, format_fault
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import Clock, Endpoint, LoopbackBus, Ticket, import_participant, main
from stepbus_participant.session.exchange import Exchange
from stepbus_schemas import SPOKEN, Batch, WiringError

_BATCH = 0x82
"""A map of two entries; `Outputs` have three and more."""
_decode_batch = msgspec.msgpack.Decoder(Batch).decode
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def check_scenario(scenario: Scenario, instead: str = "omit --in-process") -> None:
    """Raise WiringError for a scenario that cannot run in one process, with every reason.

    instead: what the user can do, or why nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        # Signals, which interrupt a late participant, are handled there only.
        raise WiringError(f"a run in one process takes the main thread of your program; {instead}")
    elsewhere = [spec.name for spec in scenario.participants if not spec.is_here]
    if elsewhere:
        raise WiringError(
            f"{', '.join(elsewhere)}: a participant that is external, or on another host, needs a "
            f"process of its own; {instead}"
        )
    faults = faults_of(scenario.faults, PROCESS_FAULTS)
    if faults:
        texts = ", ".join(f"'{format_fault(fault)}'" for fault in faults)
        raise WiringError(f"{texts}: a process fault needs a separate process; {instead}")
    problems = [
        (
            f"participants.{spec.name}: `{' '.join(spec.exec)}` is a separate program; "
            f"{_remedy(spec)}{instead}"
        )
        for spec in scenario.participants
        if not spec.participant
    ]
    if problems:
        raise WiringError("\n".join(problems))


def _remedy(spec: ParticipantSpec) -> str:
    """Return what to write instead of a program in Python."""
    if spec.exec[:1] != ("python",) or spec.bridge is not None:
        return ""
    files = [word for word in spec.exec if word.endswith(".py")]
    name = f"{files[0]}:CLASS" if files else "MODULE:CLASS"
    return f"write `participant: {name}` instead of `exec`, with the name of its class, or "


class LocalRun(Strategy):
    """Hosts all participants in this process; none is played.

    bus: the orchestrator's, whose network the participants join. is_star: as of `Processes`.
    memory: as of `InProcess`.
    """

    def __init__(
        self, run: RunView, clock: Clock, *, is_star: bool, memory: Heartbeat | None
    ) -> None:
        self.hub = Hub(clock)
        self.hub.before = self._before
        self.bus = LoopbackBus(make_queue=self.hub.queue, clock=clock)
        self.state: RunState | None = None
        self.logs = run.out / LOGS_FOLDER
        folder, specs = run.state.scenario.folder, run.state.scenario.participants
        files = [spec.participant.rpartition(":")[0] for spec in specs]
        files = [file for file in files if file.endswith(".py")]
        self.surroundings = Surroundings(folder, files)
        self.memory: Heartbeat
        self._given_memory = memory
        self._run = run
        self._is_star = is_star
        self._pid = os.getpid()
        self._places: dict[str, int] = {}
        self._handlers: dict[int, Any] = {}

    @contextlib.contextmanager
    def opened(self, *, owns_descriptors: bool) -> Iterator["LocalRun"]:
        """Put the process in order for participants; at the end, end them, and put it back."""
        native_log = self.logs / NATIVE_LOG
        with contextlib.ExitStack() as stack:
            try:
                stack.enter_context(
                    self.surroundings.around(native_log if owns_descriptors else None)
                )
            except OSError as exc:
                raise StartFailed(
                    f"before the first step: {exc.filename}: {exc.strerror}; a run in "
                    "one process works in the scenario's folder and logs to the run's "
                    "folder"
                ) from exc
            self.memory = stack.enter_context(watched(self.hub, self._given_memory))
            stack.callback(self._end_all)
            handlers = {number: signal.getsignal(number) for number in _SIGNALS}
            # Those that are None are not Python's.
            self._handlers = {n: handler for n, handler in handlers.items() if handler is not None}
            yield self

    def _end_all(self) -> None:
        for hosted in self.hub.hosted:
            hosted.end()

    def leave(self) -> None:
        """Restore the process to what our caller knew."""
        self.surroundings.leave()

    def enter(self) -> None:
        """Put in place again what participants find."""
        self.surroundings.enter()

    # --- who has the thread -----------------------------------------------------------------

    def _before(self) -> None:
        """Note how far the run is, since the orchestrator has had the thread."""
        if os.getpid() != self._pid:
            # A participant has forked: this is a second orchestrator, with the same open files.
            os.kill(os.getpid(), signal.SIGKILL)
        if self.state is None:
            return
        phase = self.state.phase
        stage = Stage.STEP if phase.is_stepping else Stage.STOP
        if phase is RunPhase.START_UP:
            stage = Stage.READY
            # Libraries that were loaded may have set others; these let the user end the run.
            for number, handler in self._handlers.items():
                signal.signal(number, handler)
        if self.memory.words[STAGE] != stage:
            self.memory.enter(stage)

    # --- its participants -------------------------------------------------------------------

    def launch(self, run: RunView) -> None:
        """Begin every participant, in the order of the scenario."""
        scenario, specs = run.state.scenario, run.state.scenario.participants
        limits = [spec.deadlines for spec in specs]
        self.memory.begin(
            {
                "result": run.result().decode(),
                "names": [spec.name for spec in specs],
                "limits": [[d.spawn_s + d.join_s + d.ready_s, d.step_s, d.stop_s] for d in limits],
                "files": [str(scenario.folder / s.participant.rpartition(":")[0]) for s in specs],
                "logs": str(self.logs),
                "path": sys.path,
            }
        )
        self.state = run.state
        options = {spec.name: run.start_options(spec) for spec in specs}
        if not self._is_star and _can_exchange(scenario, options.values()):
            self.bus.exchange = Exchange(self.hub, self.memory.words, self._places)
        for spec in specs:
            hosted = self._host(spec, scenario, options[spec.name])
            run.started(ParticipantState(spec, hosted))
            run.timing.event("spawn", spec.name, f"in process {hosted.pid}")

    def _host(
        self, spec: ParticipantSpec, scenario: Scenario, options: dict[str, Any]
    ) -> HostedParticipant:
        shown, make = options.pop("has_terminal", False), options.pop("make", None)
        ticket = Ticket(
            run=self._run.key,
            name=spec.name,
            token=self._run.token,
            endpoint=Endpoint(listen=[], connect=["this process"]),
            join_timeout_s=spec.deadlines.join_s,
            protocols=SPOKEN,
            **options,
        )
        number = min(1 + scenario.participants.index(spec), MOST - 1)
        self._places[spec.name] = PUBLISHED + number
        program = partial(main, make) if make else partial(_take_part, spec, scenario.folder)
        count = partial(count_steps, self.memory.words, PUBLISHED + number, spec.every)
        self.bus.subscribe_content(f"out/{spec.name}", count)
        try:
            return HostedParticipant(
                self.hub,
                ticket,
                LoopbackBus(self.bus, self.hub.queue, is_leaf=self._is_star),
                self.logs / f"{spec.name}.log",
                program,
                words=self.memory.words,
                number=number,
                shown=shown,
            )
        except OSError as exc:
            raise StartFailed(
                f"{spec.name} could not be started: cannot open its log: {exc.strerror}",
                participant=spec.name,
            ) from exc


_OVER_THE_BUS = ("faults", "checkpoint", "profile")
"""Fields of a ticket that have to do with messages on the bus."""


def _can_exchange(scenario: Scenario, options: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether nothing but the participants themselves takes part in what they publish."""
    specs = scenario.participants
    has_bulk = any(output.bulk for spec in specs for output in spec.outputs.values())
    is_followed = any(spec.hold is not None for spec in specs)
    return not (
        has_bulk or is_followed or any(row.get(key) for row in options for key in _OVER_THE_BUS)
    )


def count_steps(words: "memoryview[float]", place: int, every: int, data: bytes) -> None:
    """Count the steps that a participant publishes, for the outside watcher."""
    words[place] += every * (len(_decode_batch(data).outputs) if data[0] == _BATCH else 1)


def _take_part(spec: ParticipantSpec, folder: Path) -> int:
    try:
        factory = import_participant(spec.participant, folder)
    except WiringError as exc:
        raise SystemExit(str(exc)) from None
    return main(factory)
