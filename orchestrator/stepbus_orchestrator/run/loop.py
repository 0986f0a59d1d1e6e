"""Conducts one run over the bus: lets everybody in, starts, releases steps, and stops."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, NoReturn

from stepbus_orchestrator.errors import Interrupted, RunFailure, StepTimeout
from stepbus_orchestrator.recording import Descriptions, Sink, TimingRecorder, layout
from stepbus_orchestrator.scenario import Deadlines, Scenario, Schedule
from stepbus_participant import Bus
from stepbus_schemas import CallRecord, Start, encode

from .bus.announcer import Announcer
from .control.calls import CALL_KEY, Calls
from .control.injector import Injector
from .control.pace import Gate, Pace
from .fallback.safe_stop import Emergency
from .kernel.barrier import Barrier
from .kernel.deadlines import check_start, check_step, death, took_nothing
from .kernel.descriptions import check_descriptions
from .kernel.messages import Intake, RunState
from .kernel.participants import Member, Phase, input_descriptions
from .progress import Observer, Progress

TICK_S = 0.05
_PROGRESS_EVERY = 5
# A machine that slept, or an orchestrator that was suspended, is nobody's fault: one look at
# the clock counts for at most this much.
_LONGEST_TICK_S = 0.25

# Those who wait for a process that has died say so after 20 ms, and with it, at which step.
_LAST_WORDS_S = 0.1


class Conductor:
    """One run, from the first join to the last output.

    state: fill in its roster before `conduct`. ended_at: when the stop was sent, by the monotonic
    clock [s]. injector: of faults on purpose. pace: as the user wants it. planned: calls to make.

    Methods run on the caller's thread; callbacks of the bus only put what they get into the inbox.
    """

    def __init__(
        self,
        *,
        scenario: Scenario,
        bus: Bus,
        token: str,
        recorder: Sink,
        timing: TimingRecorder,
        observer: Observer,
        interrupt: threading.Event,
        injector: Injector | None = None,
        pace: Pace | None = None,
        planned: Sequence[CallRecord] = (),
    ) -> None:
        self.state = RunState(scenario, Barrier(scenario))
        self.ended_at = 0.0
        self._scenario = scenario
        self._bus = bus
        self._token = token
        self._recorder = recorder
        self._timing = timing
        self._observer = observer
        self._interrupt = interrupt
        self._inbox: SimpleQueue[tuple[Callable[[Any], None], Any]] = SimpleQueue()
        self._intake = Intake(
            state=self.state,
            bus=bus,
            token=token,
            recorder=recorder,
            timing=timing,
            died=self._check_processes,
        )
        self._emergency = Emergency(self.state, bus, token, self._intake)
        self._injector = injector
        self._pace = pace
        self._calls = Calls(
            state=self.state, bus=bus, token=token, recorder=recorder, planned=planned
        )
        gates = (injector, pace, self._calls)
        self._gates: list[Gate] = [gate for gate in gates if gate is not None]
        limit_s = max(spec.deadlines.step_s for spec in scenario.participants)
        self._announcer = Announcer(bus, token, limit_s, self._free)
        self._freed: list[str] = []
        self._released = 0
        self._completed = 0
        self._began = time.monotonic()
        self._checked_at = self._began
        self._ticks = 0
        self._open()

    def _open(self) -> None:
        """Subscribe to all we listen to."""
        bus = self._bus
        intake = self._intake
        bus.answer("join", self._to(intake.take_join))
        bus.subscribe("ready/*", self._to(intake.take_ready))
        bus.subscribe("fault/*", self._to(intake.take_fault))
        bus.subscribe("called/*", self._to(self._take_called))
        bus.answer(CALL_KEY, self._to(self._take_call))
        for spec in self._scenario.participants:
            # One key each: to ask every sample for its key takes longer than to decode it.
            bus.subscribe(f"log/{spec.name}", self._to(partial(intake.take_log, spec.name)))
        for name in self._emergency.names:
            bus.subscribe(f"out/{name}", self._to(partial(self._emergency.hear, name)))
        if any(out.bulk for spec in self._scenario.participants for out in spec.outputs.values()):
            bus.subscribe("bulk/*/*", self._to(self._take_bulk))
        alive = self._to(intake.take_alive)
        bus.watch_alive("alive/*", lambda key, is_alive: alive((key, is_alive)))
        bus.declare_alive("alive/orchestrator")

    def _to(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        put = self._inbox.put
        return lambda item: put((take, item))

    def _take_bulk(self, sample: Any) -> None:
        self._intake.take_bulk(sample)

    def _take_call(self, query: Any) -> None:
        self._calls.take_request(query)
        self._follow(always=True)

    def _take_called(self, sample: Any) -> None:
        self._calls.take_called(sample)
        self._follow(always=True)

    # --- the run ---------------------------------------------------------------------------

    def conduct(self) -> str:
        """Run to the end and return why it ended.

        Raises RunFailure when it ends before its time.
        """
        self._meet()
        self._start()
        try:
            reason = self._step()
        except RunFailure as failure:
            if self._emergency.can_handle(failure):
                self._bring_to_rest(failure)
            raise
        self._close()
        return reason

    def _bring_to_rest(self, failure: RunFailure) -> NoReturn:
        """Go on without the participant that failed for as long as the scenario says, then raise.

        The failure that is raised says what came of it.
        """
        member = self.state.roster[failure.participant or ""]
        member.child.signal(signal.SIGKILL)
        member.child.wait(_LONGEST_TICK_S)
        kind, said = type(failure), str(failure)
        self.state.replaced = member.name
        try:
            self._hear_last_error()
            first, until = self._emergency.begin(member.name, self._descriptions())
            self.state.end = (until, f"{member.name} has failed; the run was held")
            self._recorder.add_metadata(
                layout.FALLBACK_METADATA,
                {"participant": member.name, "first": str(first), "until": str(until)},
            )
            self._timing.event("hold", member.name, f"steps {first} to {until - 1}")
            self._observer.event("error", member.name, first, f"{said}; holding until step {until}")
            self._follow(always=True)
            self._step()
            self._close()
        except RunFailure as other:
            text = f"{said}; while its commands were held: {other}"
            raise kind(text, participant=member.name, step=failure.step) from other
        text = f"{said}; its commands were held from step {first} to {until} and brought to rest"
        raise kind(text, participant=member.name, step=failure.step) from failure

    @property
    def steps(self) -> int:
        """Return how many steps of the run are complete."""
        completed = max(0, self.state.barrier.completed)
        return completed if self.state.end is None else min(completed, self.state.end[0])

    def _meet(self) -> None:
        """Wait until everybody is ready."""
        while any(member.phase != Phase.READY for member in self.state.roster.values()):
            self._turn(lambda elapsed_s: check_start(self.state.roster, elapsed_s))

    def _start(self) -> None:
        """Tell everybody about their inputs; the clock stands at zero."""
        inputs = input_descriptions(self._scenario, self._descriptions())
        check_descriptions(self.state.roster, inputs)
        ready = {name: member.ready for name, member in self.state.roster.items()}
        self._recorder.open_channels(
            {name: dict(item.outputs) for name, item in ready.items() if item is not None},
            {name: dict(item.versions) for name, item in ready.items() if item is not None},
        )
        message = encode(Start(token=self._token, inputs=inputs))
        self.state.check_size("the descriptions of all inputs", message)
        if self._injector is not None:
            self._injector.check(self.state.roster)
        self._timing.event("start")
        self.state.phase = "stepping"
        self.state.started_at = time.monotonic()
        self._announcer.start(message)
        self._follow(always=True)

    def _descriptions(self) -> Descriptions:
        """Return what everybody says of its outputs."""
        ready = ((name, member.ready) for name, member in self.state.roster.items())
        return {name: item.outputs if item else {} for name, item in ready}

    def _step(self) -> str:
        """Release step after step until the run has ended; return why."""
        while not self._is_complete():
            before = sum(self.state.barrier.reported.values())
            self._turn(self._check_step)
            if sum(self.state.barrier.reported.values()) == before:
                # In case somebody has not heard it.
                is_new = min(self.state.barrier.reported.values()) < 0
                self._announcer.repeat(start=is_new)
        return self.state.end[1] if self.state.end is not None else "finished"

    def _check_step(self, elapsed_s: float) -> None:
        self._follow(always=True)
        state = self.state
        if self.held:
            return
        check_step(state.roster, state.barrier, elapsed_s, self._scenario.step_ns)

    @property
    def held(self) -> bool:
        """Return whether all that may be worked on is done, and somebody holds the run."""
        return self.state.barrier.completed >= self._released

    def _is_complete(self) -> bool:
        return self.state.barrier.completed >= self._last_step()

    def _last_step(self) -> int:
        """Return the number of steps of this run, as far as it is known."""
        if self.state.end is not None:
            return self.state.end[0]
        return self._scenario.steps if self._scenario.steps is not None else 1 << 62

    def _release(self) -> None:
        """Send the trigger on when the barrier has moved, then record what is complete."""
        step_limit = self.state.barrier.step_limit
        for gate in self._gates:
            step_limit = min(step_limit, gate.limit(self._released))
        if step_limit > self._released:
            self._released = step_limit
            self._announcer.trigger(step_limit)
            self._timing.trigger(step_limit)
        self._emergency.follow(self._released)
        self._recorder.write_below(min(self.state.barrier.completed, self._last_step()))

    def _follow(self, *, always: bool = False) -> None:
        """Release what the outputs that came in allow; always: though none did."""
        completed = self.state.barrier.completed
        if self.state.phase == "stepping" and (completed > self._completed or always):
            self._completed = completed
            if self._injector is not None:
                self._injector.act(completed, self.state.roster)
            self._calls.act(self._released)
            self._release()

    def _close(self) -> None:
        """Ask for the closing outputs, and write the end of the recording."""
        end = self._last_step()
        schedule = Schedule.of(self._scenario)
        closing = [name for name in schedule.order if schedule.closing(name, end)]
        reason = self.state.end[1] if self.state.end is not None else "finished"
        self.stop(reason, at_step=end)
        while any(self.state.barrier.reported[name] < end for name in closing):
            self._turn(lambda elapsed_s: self._check_closing(closing, end, elapsed_s))
        began = time.monotonic()
        while not self._recorder.bulk_complete():
            self._turn(lambda _elapsed_s: self._check_bulk(end, time.monotonic() - began))
        self._recorder.finish(end, closing)

    def _check_bulk(self, end: int, waited_s: float) -> None:
        deadline = max(spec.deadlines.stop_s for spec in self._scenario.participants)
        if waited_s > deadline:
            raise StepTimeout(
                f"{self.state.at(end)}: bulk content that was announced has not come "
                f"for {waited_s:.1f} s; deadline {deadline:g} s (stop_timeout); was it published?",
                step=end,
            )

    def _check_closing(self, closing: list[str], end: int, elapsed_s: float) -> None:
        for name in closing:
            if self.state.barrier.reported[name] >= end:
                continue
            member = self.state.roster[name]
            if member.child.exit_code() is not None:
                raise death(member, self.state.roster, self.state.barrier, self._scenario.step_ns)
            member.hold(end, elapsed_s)
            if member.holds_s > member.spec.deadlines.stop_s:
                raise StepTimeout(
                    f"{self.state.at(end)}: {member.who()} has not published its "
                    f"closing outputs for {member.holds_s:.1f} s; deadline "
                    f"{member.spec.deadlines.stop_s:g} s (participants.{name}.stop_timeout)",
                    participant=name,
                    step=end,
                )

    def stop(self, reason: str, at_step: int = -1) -> None:
        """Tell everybody that the run ends; negative `at_step`: at once."""
        self.ended_at = time.monotonic()
        self.state.phase = "stopping"
        self._calls.close()
        self._announcer.stop(reason, at_step)

    def end_all(self, culprit: str | None) -> list[Member]:
        """End every process, take in what it still has to say, and return those that were late.

        Each may take its stop deadline. Nobody waits for the culprit, nor for one that has not
        got ready: it has nothing to save.
        """
        members = [m for m in self.state.roster.values() if m.phase == Phase.READY]
        if culprit is not None and culprit in self.state.roster:
            # Before the others: a process that reads nothing blocks whoever sends to it.
            self.state.roster[culprit].child.end()
        late = self._await_ends([m for m in members if m.name != culprit])
        for member in self.state.roster.values():
            member.child.end()
        self._salvage(0.0)
        self._announcer.close()
        return late

    def _await_ends(self, members: list[Member]) -> list[Member]:
        began = time.monotonic()
        while True:
            left = [m for m in members if m.child.exit_code() is None]
            waited_s = time.monotonic() - began
            if not any(waited_s < self._patience_s(m) for m in left):
                return left
            self._announcer.repeat_stop()
            self._salvage(TICK_S / 5)

    def _patience_s(self, member: Member) -> float:
        """Return how long a participant may take to end [s]; not long when the user wants out."""
        stop_s = member.spec.deadlines.stop_s
        return min(stop_s, Deadlines.stop_s) if self._interrupt.is_set() else stop_s

    def _salvage(self, timeout_s: float) -> None:
        """Take in what comes; the run has failed already, a further failure changes nothing."""
        while True:
            with contextlib.suppress(RunFailure):
                self._drain(timeout_s)
                return

    # --- one turn of the loop --------------------------------------------------------------

    def _turn(self, check: Callable[[float], None]) -> None:
        """Take in what comes within a tick; look at clocks, processes and the user after it."""
        self._drain(TICK_S)
        self._follow()
        if self._interrupt.is_set():
            raise Interrupted("interrupted by the user", step=self.state.barrier.completed)
        elapsed_s = time.monotonic() - self._checked_at
        if elapsed_s < TICK_S:
            return
        self._checked_at += elapsed_s
        check(min(elapsed_s, _LONGEST_TICK_S))
        self._check_processes()
        self._ticks += 1
        if self._ticks % _PROGRESS_EVERY == 0:
            self._observer.progress(self.progress())

    def _drain(self, timeout_s: float) -> None:
        """Wait for the next item and take in all that have come with it."""
        try:
            take, item = self._inbox.get(timeout=timeout_s)
        except Empty:
            return
        take(item)
        # Not until it is empty: somebody who floods the bus must not keep us from the clock.
        for _ in range(self._inbox.qsize()):
            take, item = self._inbox.get()
            take(item)

    def _check_processes(self) -> None:
        """Raise for a process that has ended before the run."""
        if self.state.phase == "stopping":
            return
        for member in self.state.roster.values():
            if member.child.exit_code() is not None and member.name != self.state.replaced:
                if member.name in self._freed:
                    raise took_nothing(
                        member, self.state.roster, self.state.barrier, self._scenario.step_ns
                    )
                self._mourn(member)

    def _free(self) -> None:
        """End whoever reads nothing, while a message to it keeps us from everything else."""
        roster = self.state.roster
        frozen = [name for name, member in roster.items() if member.child.is_stopped()]
        for name in frozen or self.state.barrier.holders() or roster:
            self._freed.append(name)
            roster[name].child.signal(signal.SIGKILL)

    def _hear_last_error(self) -> None:
        deadline = time.monotonic() + _LAST_WORDS_S
        while time.monotonic() < deadline:
            self._drain(TICK_S / 5)

    def _mourn(self, member: Member) -> None:
        """Raise for a process that has ended, after hearing what it and the others have to say."""
        self._hear_last_error()
        raise death(member, self.state.roster, self.state.barrier, self._scenario.step_ns)

    def progress(self) -> Progress:
        """Return how far the run is."""
        roster = self.state.roster.values()
        is_paused = self.state.phase == "stepping" and self.held
        return Progress(
            phase="paused" if is_paused else self.state.phase,
            step=self.steps,
            steps=self._scenario.steps,
            step_ns=self._scenario.step_ns,
            elapsed_s=time.monotonic() - (self.state.started_at or self._began),
            phases={member.name: member.phase.name.lower() for member in roster},
            compute_us={
                name: total / count * 1e-3 for name, (total, count) in self.state.compute.items()
            },
            drops={member.name: sum(member.drops.values()) for member in roster},
            holders=tuple(self.state.barrier.holders())
            if self.state.phase == "stepping" and not is_paused
            else (),
        )
