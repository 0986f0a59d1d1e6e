"""Conducts one run over the bus: lets everybody in, starts, releases steps, and stops."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from stepbus import Bus
from stepbus.outbox import read_stamp
from stepbus_schemas import (
    Decoder,
    Fault,
    Hello,
    Log,
    MessageError,
    Outputs,
    Ready,
    Refusal,
    Start,
    Stop,
    Trigger,
    encode,
    encoding_of,
)

from .barrier import Barrier
from .deadlines import at, check_start, check_step, death, skipped
from .descriptions import check_descriptions
from .endpoints import ORCHESTRATOR
from .errors import Interrupted, ParticipantFault, RunFailure, StartFailed, StepTimeout
from .progress import Observer, Progress
from .reception import max_message_bytes, receive, welcome_of
from .roster import Descriptions, Member, Phase, Roster, input_descriptions
from .scenario import Scenario, Schedule
from .sink import Sink
from .timing import TimingRecorder

TICK_S = 0.05
_PROGRESS_EVERY = 5
# A machine that slept, or an orchestrator that was suspended, is nobody's fault: one look at
# the clock counts for at most this much.
_LONGEST_TICK_S = 0.25

# Those who wait for a process that has died say so after 20 ms, and with it, at which step.
_LAST_WORDS_S = 0.1

_decode_hello = Decoder(Hello)
_decode_ready = Decoder(Ready)
_decode_log = Decoder(Log)
_decode_outputs = Decoder(Outputs)
_decode_fault = Decoder(Fault)


class Conductor:
    """One run, from the first join to the last output.

    roster: fill it in before `conduct`. started_at, ended_at: when the first trigger and the
    stop were sent, by the monotonic clock [s]. Methods run on the caller's thread; callbacks of
    the bus only put what they get into the inbox.
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
    ) -> None:
        self.roster: Roster = {}
        self.barrier = Barrier(scenario)
        self.foreign = 0
        self.started_at = 0.0
        self.ended_at = 0.0
        self._scenario = scenario
        self._bus = bus
        self._token = token
        self._recorder = recorder
        self._timing = timing
        self._observer = observer
        self._interrupt = interrupt
        self._inbox: SimpleQueue[tuple[Callable[[Any], None], Any]] = SimpleQueue()
        self._welcomes = {
            spec.name: welcome_of(scenario, spec, token) for spec in scenario.participants
        }
        self._end: tuple[int, str] | None = None
        self._released = 0
        self._phase = "starting"
        self._began = time.monotonic()
        self._checked_at = self._began
        self._ticks = 0
        self._compute: dict[str, tuple[int, int]] = {}
        self._open()

    def _open(self) -> None:
        """Subscribe to all we listen to."""
        bus = self._bus
        self._put_start = bus.publisher("start", encoding_of("Start/1"))
        self._put_trigger = bus.publisher("trigger", encoding_of("Trigger/1"))
        self._put_stop = bus.publisher("stop", encoding_of("Stop/1"))
        bus.answer("join", self._to(self._take_join))
        bus.subscribe("ready/*", self._to(self._take_ready))
        bus.subscribe("log/*", self._to(self._take_log))
        bus.subscribe("fault/*", self._to(self._take_fault))
        if any(out.bulk for spec in self._scenario.participants for out in spec.outputs.values()):
            bus.subscribe("bulk/*/*", self._to(self._take_bulk))
        alive = self._to(self._take_alive)
        bus.watch_alive("alive/*", lambda key, is_alive: alive((key, is_alive)))
        bus.declare_alive("alive/orchestrator")

    def _to(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        put = self._inbox.put
        return lambda item: put((take, item))

    # --- the run ---------------------------------------------------------------------------

    def conduct(self) -> str:
        """Run to the end and return why it ended.

        Raises RunFailure when it ends before its time.
        """
        self._meet()
        self._start()
        reason = self._step()
        self._close()
        return reason

    @property
    def steps(self) -> int:
        """Return how many steps of the run are complete."""
        completed = max(0, self.barrier.completed)
        return completed if self._end is None else min(completed, self._end[0])

    def _meet(self) -> None:
        """Wait until everybody is ready."""
        while any(member.phase != Phase.READY for member in self.roster.values()):
            self._turn(lambda elapsed_s: check_start(self.roster, elapsed_s))

    def _start(self) -> None:
        """Tell everybody about their inputs; the clock stands at zero."""
        inputs = input_descriptions(self._scenario, self._descriptions())
        check_descriptions(self.roster, inputs)
        ready = {name: member.ready for name, member in self.roster.items()}
        self._recorder.open_channels(
            {name: dict(item.outputs) for name, item in ready.items() if item is not None},
            {name: dict(item.versions) for name, item in ready.items() if item is not None},
        )
        self._start_message = encode(Start(token=self._token, inputs=inputs))
        self._check_size("the descriptions of all inputs", self._start_message)
        self._timing.event("start")
        self._phase = "stepping"
        self.started_at = time.monotonic()
        self._put_start(self._start_message)
        self._release()

    def _descriptions(self) -> Descriptions:
        """Return what everybody says of its outputs."""
        ready = ((name, member.ready) for name, member in self.roster.items())
        return {name: item.outputs if item else {} for name, item in ready}

    def _step(self) -> str:
        """Release step after step until the run has ended; return why."""
        while not self._is_complete():
            before = self.barrier.reported.copy()
            self._turn(
                lambda elapsed_s: check_step(
                    self.roster, self.barrier, elapsed_s, self._scenario.step_ns
                )
            )
            if self.barrier.reported == before:
                self._repeat()
        return self._end[1] if self._end is not None else "finished"

    def _is_complete(self) -> bool:
        return self.barrier.completed >= self._last_step()

    def _last_step(self) -> int:
        """Return the number of steps of this run, as far as it is known."""
        if self._end is not None:
            return self._end[0]
        return self._scenario.steps if self._scenario.steps is not None else 1 << 62

    def _repeat(self) -> None:
        """Say the newest word again, in case somebody has not heard it."""
        if min(self.barrier.reported.values()) < 0:
            self._put_start(self._start_message)
        self._put_trigger(encode(Trigger(token=self._token, upto=self._released)))

    def _release(self) -> None:
        """Send the trigger on when the barrier has moved, then record what is complete."""
        upto = self.barrier.upto
        if upto > self._released:
            self._released = upto
            self._put_trigger(encode(Trigger(token=self._token, upto=upto)))
            self._timing.trigger(upto)
        self._recorder.write_below(min(self.barrier.completed, self._last_step()))

    def _close(self) -> None:
        """Ask for the closing outputs, and write the end of the recording."""
        end = self._last_step()
        schedule = Schedule.of(self._scenario)
        closing = [name for name in schedule.order if schedule.closing(name, end)]
        reason = self._end[1] if self._end is not None else "finished"
        self.stop(reason, at_step=end)
        while any(self.barrier.reported[name] < end for name in closing):
            self._turn(lambda elapsed_s: self._check_closing(closing, end, elapsed_s))
        began = time.monotonic()
        while not self._recorder.bulk_complete():
            self._turn(lambda _elapsed_s: self._check_bulk(end, time.monotonic() - began))
        self._recorder.finish(end, closing)

    def _check_bulk(self, end: int, waited_s: float) -> None:
        deadline = max(spec.deadlines.stop_s for spec in self._scenario.participants)
        if waited_s > deadline:
            raise StepTimeout(
                f"{at(end, self._scenario.step_ns)}: bulk content that was announced has not come "
                f"for {waited_s:.1f} s; deadline {deadline:g} s (stop_timeout); was it published?",
                step=end,
            )

    def _check_closing(self, closing: list[str], end: int, elapsed_s: float) -> None:
        for name in closing:
            if self.barrier.reported[name] >= end:
                continue
            member = self.roster[name]
            if member.child.exit_code() is not None:
                raise death(member, self.roster, self.barrier, self._scenario.step_ns)
            member.hold(end, elapsed_s)
            if member.holds_s > member.spec.deadlines.stop_s:
                raise StepTimeout(
                    f"{at(end, self._scenario.step_ns)}: {member.who()} has not published its "
                    f"closing outputs for {member.holds_s:.1f} s; deadline "
                    f"{member.spec.deadlines.stop_s:g} s (participants.{name}.stop_timeout)",
                    participant=name,
                    step=end,
                )

    def stop(self, reason: str, at_step: int = -1) -> None:
        """Tell everybody that the run ends; negative `at_step`: at once."""
        self.ended_at = time.monotonic()
        self._phase = "stopping"
        self._stop_message = encode(Stop(token=self._token, reason=reason, at_step=at_step))
        self._put_stop(self._stop_message)

    def end_all(self, culprit: str | None) -> list[Member]:
        """End every process, take in what it still has to say, and return those that were late.

        Each may take its stop deadline. Nobody waits for the culprit, nor for one that has not
        got ready: it has nothing to save.
        """
        members = [m for m in self.roster.values() if m.phase == Phase.READY]
        late = self._await_ends([m for m in members if m.name != culprit])
        for member in self.roster.values():
            member.child.end()
        self._salvage(0.0)
        return late

    def _await_ends(self, members: list[Member]) -> list[Member]:
        began = time.monotonic()
        while True:
            left = [m for m in members if m.child.exit_code() is None]
            waited_s = time.monotonic() - began
            if not any(waited_s < m.spec.deadlines.stop_s for m in left):
                return left
            self._put_stop(self._stop_message)
            self._salvage(TICK_S / 5)

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
        if self._interrupt.is_set():
            raise Interrupted("interrupted by the user", step=self.barrier.completed)
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
        if self._phase == "stopping":
            return
        for member in self.roster.values():
            if member.child.exit_code() is not None:
                self._mourn(member)

    def _mourn(self, member: Member) -> None:
        """Raise for a process that has ended, after hearing what it and the others have to say."""
        deadline = time.monotonic() + _LAST_WORDS_S
        while time.monotonic() < deadline:
            self._drain(TICK_S / 5)
        raise death(member, self.roster, self.barrier, self._scenario.step_ns)

    def progress(self) -> Progress:
        """Return how far the run is."""
        roster = self.roster.values()
        return Progress(
            phase=self._phase,
            step=self.steps,
            steps=self._scenario.steps,
            step_ns=self._scenario.step_ns,
            elapsed_s=time.monotonic() - (self.started_at or self._began),
            phases={member.name: member.phase.name.lower() for member in roster},
            compute_us={
                name: total / count * 1e-3 for name, (total, count) in self._compute.items()
            },
            drops={member.name: sum(member.drops.values()) for member in roster},
            holders=tuple(self.barrier.holders()) if self._phase == "stepping" else (),
        )

    # --- what comes in ---------------------------------------------------------------------

    def _take_alive(self, item: tuple[str, bool]) -> None:
        key, alive = item
        name = key.removeprefix("alive/")
        member = self.roster.get(name)
        if member is None:
            self.foreign += alive and name != ORCHESTRATOR
            return
        if alive and member.advance(Phase.ALIVE):
            self._timing.event("alive", member.name)
        if not alive and self._phase != "stopping" and member.child.wait(TICK_S):
            self._check_processes()

    def _take_join(self, request: Any) -> None:
        try:
            hello = _decode_hello(request.payload)
        except MessageError as exc:
            self.foreign += 1
            request.reply(encode(Refusal(reason=str(exc))), encoding_of("Refusal/1"))
            return
        # Nobody of ours can ask before its process is started.
        welcomes = {name: self._welcomes[name] for name in self.roster}
        answer = receive(hello, welcomes, self._token)
        if isinstance(answer, Refusal):
            request.reply(encode(answer), encoding_of("Refusal/1"))
            self._refused(hello, answer)
            return
        welcome = encode(answer)
        self._check_size(f"the params of {hello.name}", welcome)
        request.reply(welcome, encoding_of("Welcome/1"))
        member = self.roster[hello.name]
        member.language = hello.language
        if member.advance(Phase.JOINED):
            self._timing.event("join", member.name, f"{hello.language} {hello.sdk}".strip())

    def _check_size(self, what: str, data: bytes) -> None:
        """Refuse what the low-latency transport would silently lose."""
        limit = max_message_bytes(self._scenario)
        if len(data) > limit:
            raise StartFailed(
                f"before the first step: {what} take {len(data)} bytes, over the {limit} that the "
                "low-latency transport carries; set bus.low_latency: false"
            )

    def _refused(self, hello: Hello, refusal: Refusal) -> None:
        """End the run when one of ours cannot join; a stranger is only counted."""
        if hello.token != self._token or hello.name not in self.roster:
            self.foreign += 1
            return
        raise StartFailed(
            f"before the first step: {self.roster[hello.name].who()} was refused: {refusal.reason}",
            participant=hello.name,
        )

    def _member(self, sample: Any, token: str, name: str) -> Member | None:
        """Return whom a message is from; None, and counted, when it is a stranger's."""
        member = self.roster.get(name)
        if token != self._token or member is None or not self._bus.key(sample).endswith(f"/{name}"):
            self.foreign += 1
            return None
        return member

    def _take_ready(self, sample: Any) -> None:
        try:
            ready = _decode_ready(self._bus.payload(sample))
        except MessageError:
            self.foreign += 1
            return
        member = self._member(sample, ready.token, ready.name)
        if member is not None and member.advance(Phase.READY):
            member.ready = ready
            self._timing.event("ready", member.name)

    def _take_log(self, sample: Any) -> None:
        try:
            log = _decode_log(self._bus.payload(sample))
        except MessageError:
            self.foreign += 1
            return
        member = self._member(sample, log.token, log.name)
        if member is None:
            return
        self._check_waiting(member, log)
        member.waiting, member.drops = log.waiting, log.drops
        completed = self.barrier.completed
        for raw in log.outputs:
            self._take_outputs(member, raw)
        if self._phase == "stepping" and self.barrier.completed > completed:
            self._release()
        if log.timing:
            self._note_timing(log)

    def _check_waiting(self, member: Member, log: Log) -> None:
        if log.waiting is None:
            return
        sources = [item.source for item in member.spec.inputs.values()]
        if any(name not in sources for name in log.waiting.sources):
            raise self._broken(member, "says it waits for somebody who is no source of it")

    def _take_outputs(self, member: Member, raw: Any) -> None:
        step_ns = self._scenario.step_ns
        if not self.started_at:
            raise self._broken(member, "logged outputs before the start")
        try:
            outputs = _decode_outputs(raw)
        except MessageError as exc:
            raise self._broken(member, f"logged something that is {exc}") from exc
        if outputs.token != self._token or outputs.t_ns != outputs.step * step_ns:
            raise self._broken(member, f"sent a wrong token or time (t_ns = {outputs.t_ns})")
        published = (*outputs.ports, *outputs.bulk)
        unknown = [port for port in published if port not in member.spec.outputs]
        if unknown:
            raise self._broken(member, f"published on {unknown[0]!r}, not a port of the scenario")
        specs = member.spec.outputs
        if any(specs[port].bulk != (port in outputs.bulk) for port in published):
            raise self._broken(member, "published a port as bulk that is none, or the reverse")
        if not self.barrier.report(member.name, outputs.step):
            raise skipped(member, outputs.step, self.barrier, step_ns)
        self._recorder.offer(member.name, outputs)
        if outputs.end is not None:
            end = (outputs.step + 1, f"{member.name}: {outputs.end}")
            self._end = end if self._end is None else min(self._end, end)

    def _broken(self, member: Member, what: str) -> ParticipantFault:
        step = self.barrier.next_step(member.name)
        return ParticipantFault(
            f"{at(step, self._scenario.step_ns)}: {member.who()} {what}; see docs/protocol.md",
            participant=member.name,
            step=step,
        )

    def _note_timing(self, log: Log) -> None:
        self._timing.steps(log.name, log.timing)
        total, count = self._compute.get(log.name, (0, 0))
        total += sum(computed for _, _, computed in log.timing)
        self._compute[log.name] = (total, count + len(log.timing))

    def _take_bulk(self, sample: Any) -> None:
        step = read_stamp(self._bus.attachment(sample), self._token)
        _, name, port = self._bus.key(sample).split("/")
        member = self.roster.get(name)
        output = member.spec.outputs.get(port) if member is not None else None
        if step is None or output is None or not output.bulk:
            self.foreign += 1
        elif step >= 0:
            self._recorder.offer_bulk(name, port, step, self._bus.payload(sample))

    def _take_fault(self, sample: Any) -> None:
        try:
            fault = _decode_fault(self._bus.payload(sample))
        except MessageError:
            self.foreign += 1
            return
        member = self._member(sample, fault.token, fault.name)
        if member is None:
            return
        blamed = self.roster.get(fault.blames or fault.name, member)
        seen = "" if blamed is member else f" (seen by {member.who()})"
        where = at(fault.step, self._scenario.step_ns)
        kind = StartFailed if member.phase < Phase.READY else ParticipantFault
        raise kind(
            f"{where}: {blamed.who()}: {fault.message}{seen}; its log: {blamed.child.log}",
            participant=blamed.name,
            step=fault.step,
        )
