"""Runs a tape: the production code, on a simulated host, with what goes wrong."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import signal
import threading
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

from stepbus_orchestrator.recording import McapFile
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.extensions.faults import Faults
from stepbus_orchestrator.run.extensions.safe_stop import SafeStop
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.fault_texts import FAULT_TYPES, MESSAGE_FAULTS, format_fault
from stepbus_orchestrator.scenario.model import FaultSpec
from stepbus_participant import MessageFault, Participant
from stepbus_participant.session.faulty import FaultyPublisher
from stepbus_schemas import StepbusError

from .disk import SimulatedDisk
from .escapes import Escape, no_escapes
from .host import SimulatedHost
from .network import Link, Network, Parcel
from .programs import CALLS, SCENARIOS, scenario
from .tape import MS, ORCHESTRATOR, Fault, Tape
from .world import NS, Livelock, Process, World

_REAL_S = 30
"""A run takes some hundredths of this."""
_ENDS_NS = NS
"""What a run may take beside its deadlines and faults."""
_THAW_NS = 100 * MS

Change = Callable[[Link, Parcel], list[Parcel]]
"""Takes what a link was to carry, and returns what it carries."""


class Execution:
    """One run of a tape.

    out: its folder, which is made. keeps_trace: whether the world keeps a trace.

    result: of the run; None where there is none. refusal: the error that it raised instead, one of
    ours. crash: the traceback of any other. late: what had not ended in time. effective: the
    faults that have struck. lasting_ns: how much later its faults may make its end. watch: of the
    recording. in_step: (participant, step) → what happens in the midst of it. writes_files: whether
    it may write files beside the simulated disk.
    """

    writes_files = False

    def __init__(self, tape: Tape, out: Path, *, keeps_trace: bool = False) -> None:
        self.tape = tape
        self.out = out
        self.world = World(keeps_trace=keeps_trace)
        self.network = Network(self.world, tape.knobs)
        self.network.change = self._changed
        self.orchestrator = Process(self.world, ORCHESTRATOR, self._orchestrate)
        self.disk = SimulatedDisk(self.orchestrator)
        self.host = SimulatedHost(self.network, self.orchestrator, self.disk, self._wrap)
        self.interrupt = threading.Event()
        self.result: Result | None = None
        self.refusal: StepbusError | None = None
        self.crash = ""
        self.late: list[str] = []
        self.effective: list[Fault] = []
        self.watch = _Watch()
        self.is_healed = False
        self.lasting_ns = 0
        self._limit_ns = 0
        """Before this time, it is not late, whenever its first step was."""
        self.in_step: dict[tuple[str, int], list[Callable[[], None]]] = defaultdict(list)
        self._injected = {
            self._fault_of(fault): fault for fault in tape.faults if fault.kind in FAULT_TYPES
        }
        self._changes: list[tuple[str, str, str, Change]] = []

    # --- what the kinds of faults use -------------------------------------------------------

    def struck(self, fault: Fault) -> None:
        """Note that a fault has taken effect."""
        if fault not in self.effective:
            self.effective.append(fault)
            self.world.note(f"struck: {fault}")

    def as_options(self) -> list[str]:
        """Return the faults that have struck as texts of `--fault`, as far as it has them."""
        return [format_fault(item) for item, own in self._injected.items() if own in self.effective]

    def strike(self, fault: Fault, act: Callable[[Execution, Fault], None]) -> None:
        """Let a fault take effect."""
        self.struck(fault)
        act(self, fault)

    def process(self, name: str) -> Process:
        """Return a process that has been started."""
        return self.orchestrator if name == ORCHESTRATOR else self.host.participants[name].process

    def every(self, name: str) -> int:
        """Return how many steps a participant fires apart."""
        return int(SCENARIOS[self.tape.scenario][name].get("every", 1))

    def do_in_step(self, name: str, step: int) -> None:
        """Do what happens to a participant in the midst of a step."""
        for act in () if self.is_healed else self.in_step.get((name, step), ()):
            act()

    def on_message(self, source: str, target: str, key: str, change: Change) -> None:
        """Let a function return what links carry in place of messages.

        source, target: processes. key: the first part of one, such as `out`. Empty: any.
        """
        self._changes.append((source, target, key, change))

    # --- how they take effect ---------------------------------------------------------------

    def _fault_of(self, fault: Fault) -> FaultSpec:
        """Return a fault of the tape as one of `--fault`."""
        step = min(fault.at, self.tape.steps - 1)
        if fault.kind in MESSAGE_FAULTS:
            step -= step % self.every(fault.target)
        lasts_ns = fault.amount or None
        return FaultSpec(type=fault.kind, participant=fault.target, step=step, duration_ns=lasts_ns)

    def _injecting(self, inject: Callable[..., None]) -> Callable[..., None]:
        """Return how the run injects a fault into a process: not where all is healed."""

        def injecting(faults: Faults, fault: FaultSpec, process: Any) -> None:
            if not self.is_healed:
                self.struck(self._injected[fault])
                inject(faults, fault, process)

        return injecting

    def _publishing(self, apply: Callable[..., list[bytes]]) -> Callable[..., list[bytes]]:
        """Return how a participant injects one into its messages: not where all is healed."""

        def applying(put: Any, fault: MessageFault, messages: list[bytes]) -> list[bytes]:
            if self.is_healed:
                return messages
            for spec, own in self._injected.items():
                name = self.world.current().name
                if (spec.type, spec.participant, spec.step) == (fault.type, name, fault.step):
                    self.struck(own)
            return apply(put, fault, messages)

        return applying

    def _changed(self, link: Link, key: str, data: bytes) -> list[Parcel]:
        here = link.source.process.name, link.target.process.name, key.partition("/")[0]
        parcels = [Parcel(data)]
        for *wanted, change in self._changes:
            if all(not one or one == other for one, other in zip(wanted, here, strict=True)):
                parcels = [new for parcel in parcels for new in change(link, parcel)]
        return parcels

    def _wrap(self, name: str, factory: Any) -> Any:
        execution, compute_us = self, self.tape.knobs.compute_us

        class Struck(factory):  # type: ignore[misc]
            def __init__(self, config: Any) -> None:
                execution.do_in_step(name, -1)
                super().__init__(config)

            def update(self, step: Any) -> Any:
                if compute_us:
                    execution.host.participants[name].process.clock.sleep(compute_us * 1e-6)
                execution.do_in_step(name, step.index)
                return super().update(step)

            def output(self, step: Any) -> Any:
                # An update follows, but at the closing step.
                if step.index == execution.tape.steps:
                    execution.do_in_step(name, step.index)
                return super().output(step)

        if factory.output is Participant.output:
            del Struck.output
        return Struck

    def _orchestrate(self) -> int:
        tape = self.tape
        calls = [call for call in CALLS.get(tape.scenario, ()) if call.step < tape.steps]
        options = Options(out=self.out, host=self.host, extensions=[Calls(calls), self.watch])
        try:
            made = scenario(tape.scenario, tape.steps, tape.knobs)
            made = dataclasses.replace(made, faults=tuple(self._injected))
            self.result = run(made, options, None, self.interrupt)
        except StepbusError as exc:
            self.refusal = exc
        except (Exception, Escape):  # noqa: BLE001  the judge says so
            self.crash = traceback.format_exc()
        return 0

    def run(self) -> None:
        """Run it until all processes have ended, or should have."""
        scenario(self.tape.scenario, self.tape.steps, self.tape.knobs)  # reads files
        with (
            contextlib.redirect_stderr(io.StringIO()),
            patch.object(McapFile, "chunk_bytes", self.tape.knobs.chunk_bytes),
            patch.object(FaultyPublisher, "_apply", self._publishing(FaultyPublisher._apply)),
            patch.object(Faults, "_inject", self._injecting(Faults._inject)),
            no_escapes(writes_files=self.writes_files),
            _real_time_limit(),
        ):
            self._run()

    def _run(self) -> None:
        self._limit_ns = self._longest_ns()
        if self.tape.knobs.heal_ms:
            self.world.after(MS * self.tape.knobs.heal_ms, self._heal)
        self.orchestrator.start()
        try:
            self.world.go(lambda: self.orchestrator.is_dead or self._is_late())
            if self.orchestrator.is_dead:
                # Soon nothing holds those up any more that it has left behind; some hear that it
                # has gone before they go on.
                for process in self.world.processes:
                    self.world.after(_THAW_NS, process.thaw)
                until_ns = self.world.now_ns + self._longest_ns()
                until_ns += MS * self.tape.knobs.starting_ms
                self.world.go(lambda: not self._alive() or self.world.now_ns > until_ns)
        except Livelock as exc:
            self.late.append(str(exc))
        self.late += self._alive()
        for process in self.world.processes:
            process.kill()
        for process in self.world.processes:
            process.unwind()

    def _alive(self) -> list[str]:
        return [process.name for process in self.world.processes if not process.is_dead]

    def _heal(self) -> None:
        """End all that goes on: from here on, nothing keeps the run from its end."""
        self.world.note("all is healed")
        self.is_healed = True
        self.network.heal_all()
        self.disk.strike = lambda _name, size: size
        for process in self.world.processes:
            process.on_call.clear()
            process.thaw()

    def _is_late(self) -> bool:
        if self.world.now_ns <= self._limit_ns:
            return False
        started_s = self.watch.started_s
        began_ns = int(NS * started_s) if started_s else MS * self.tape.knobs.starting_ms
        self._limit_ns = began_ns + self._longest_ns()
        return self.world.now_ns > self._limit_ns

    def _longest_ns(self) -> int:
        """Return how long a run may take from its first step on."""
        knobs = self.tape.knobs
        deadlines_ns = 2 * MS * (knobs.step_ms + knobs.stop_ms)
        work_ns = 1000 * self.tape.steps * (3 * knobs.compute_us + 6 * knobs.link_us)
        return work_ns + deadlines_ns + MS * knobs.heal_ms + self.lasting_ns + _ENDS_NS


@contextlib.contextmanager
def _real_time_limit() -> Iterator[None]:
    """End what goes round and round in no simulated time."""

    def end(_number: int, _frame: Any) -> None:
        raise Livelock(f"{_REAL_S} s of real time, and no end")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, _REAL_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


class _Watch(RunExtension):
    """Sees how far a run is.

    written: (time [ns], step) of each recorded step.
    """

    def __init__(self) -> None:
        self.is_recorded = False
        self.written: list[tuple[int, int]] = []
        self._run: Run | None = None

    @property
    def state(self) -> RunState:
        """Return the state of the run."""
        assert self._run is not None
        return self._run.state

    @property
    def started_s(self) -> float:
        """Return when the first step began, by the monotonic clock [s]; 0 before."""
        return self._run.state.started_at if self._run is not None else 0.0

    @property
    def replaced(self) -> str:
        """Return the participant that was replaced; empty where none was."""
        return (self._run.state.replaced or "") if self._run is not None else ""

    @property
    def held(self) -> tuple[int, int]:
        """Return the first step for which a participant was replaced, and the end of the run."""
        extensions = () if self._run is None else self._run.extensions
        steps = (item.replaced_steps for item in extensions if isinstance(item, SafeStop))
        return next(steps, (0, 0))

    def attach(self, run: RunView) -> None:
        """Follow the recorder."""
        assert isinstance(run, Run)
        self._run = run
        super().attach(run)
        recorder, clock = run.recorder, run.clock
        write_below, finish = recorder.write_below, recorder.finish

        def watched_write_below(step: int) -> None:
            write_below(step)
            self.written.append((clock.monotonic_ns(), step))

        def watched_finish(closing_step: int, closing: Any) -> None:
            finish(closing_step, closing)
            self.is_recorded = True

        with contextlib.suppress(AttributeError):
            recorder.write_below = watched_write_below  # type: ignore[method-assign]
            recorder.finish = watched_finish  # type: ignore[method-assign]
