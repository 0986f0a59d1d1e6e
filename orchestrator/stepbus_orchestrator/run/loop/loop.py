"""What all phases of a run share: one wait, one check of deadlines and processes, one release."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from stepbus_orchestrator.errors import Interrupted, RunFailure
from stepbus_orchestrator.recording import CheckpointWriter, Descriptions, Sink, TimingRecorder
from stepbus_orchestrator.run.bus.session import Session
from stepbus_orchestrator.run.bus.subscriptions import subscribe
from stepbus_orchestrator.run.control.calls import Calls
from stepbus_orchestrator.run.control.injector import Injector
from stepbus_orchestrator.run.control.invitations import Invitations
from stepbus_orchestrator.run.control.pace import Pace
from stepbus_orchestrator.run.control.real_time import RealTime
from stepbus_orchestrator.run.control.speed import Speed
from stepbus_orchestrator.run.control.steering import RunSteering
from stepbus_orchestrator.run.fallback.safe_stop import SafeStop
from stepbus_orchestrator.run.kernel.failures import death, kept_thread, took_nothing
from stepbus_orchestrator.run.kernel.gates import Gate, step_limit
from stepbus_orchestrator.run.kernel.messages import MessageHandler
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.reports.angles import measured_angles
from stepbus_orchestrator.run.reports.progress import Observer, Progress, Silent
from stepbus_schemas import CallRecord

from .strategy import Strategy

TICK_S = 0.05
SHORT_TICK_S = TICK_S / 5
LONGEST_TICK_S = 0.25
"""One check counts for at most this long: a machine that slept is nobody's fault (P12.1)."""

LAST_REPORTS_S = 0.1
"""Those who wait for a process that has died report after 20 ms at which step (P9.2, P9.3)."""

_PROGRESS_EVERY = 5
_FLUSH_EVERY = 4
"""In ticks: a kill -9 costs at most 0.25 s of the recording, and what is in flight."""


@dataclass(frozen=True, kw_only=True)
class Records:
    """Where a run is written.

    recorder: gets the outputs. timing: gets what the clock shows. checkpoints: gets the states that
    participants save; None: nobody is asked to.
    """

    recorder: Sink
    timing: TimingRecorder
    checkpoints: CheckpointWriter | None = None


@dataclass(frozen=True, kw_only=True)
class Controls:
    """What acts on a run from outside.

    observer: is notified of progress. interrupt: ends it when it is set. injector: of faults.
    pace: pauses it. prefix: holds it before its first live step. calls: of a recording, made
    again. new_calls: made at their steps; one that fails ends the run. invitations: of participants
    that somebody else starts. real_time: lets steps begin on the grid of the wall clock.
    """

    observer: Observer = field(default_factory=Silent)
    interrupt: threading.Event = field(default_factory=threading.Event)
    injector: Injector | None = None
    pace: Pace | None = None
    prefix: Gate | None = None
    calls: Sequence[CallRecord] = ()
    new_calls: Sequence[CallRecord] = ()
    invitations: Invitations | None = None
    real_time: RealTime | None = None


class RunLoop:
    """The tools of the phases; `phases.run_phases` drives it.

    state: of the run. descriptions: of all outputs, from the end of the start-up on. ended_at:
    when the stop was sent, by the monotonic clock [s]. is_recorded: whether the recorder has been
    asked to finish, so that it must not be asked to abort.

    Methods run on the caller's thread, but for `kill_blockers`.
    """

    def __init__(
        self, session: Session, strategy: Strategy, records: Records, controls: Controls
    ) -> None:
        self.state = RunState(session.scenario)
        self.session = session
        self.announcer = session.announcer
        self.strategy = strategy
        self.recorder = records.recorder
        self.timing = records.timing
        self.controls = controls
        self.descriptions: Descriptions = {}
        self.ended_at = 0.0
        self.is_recorded = False
        messages = MessageHandler(
            self.state,
            session.token,
            records.recorder,
            records.timing,
            replayed=strategy.peers.names,
            checkpoints=records.checkpoints,
        )
        self.safe_stop = SafeStop(session, self.state, messages)
        self.calls = Calls(
            session, self.state, records.recorder, controls.calls, controls.new_calls
        )
        self.pace = controls.pace or Pace()
        self.speed = Speed(session.scenario.step_ns)
        self.steering = RunSteering(
            self.state, self.pace, self.speed, self.progress, controls.interrupt
        )
        if controls.real_time is not None:
            self.steering.real_time = controls.real_time.factor
        self.calls.steer = self.steering.take
        gates = (controls.injector, self.pace, self.speed, controls.prefix, self.calls)
        self._gates: list[Gate] = [gate for gate in gates if gate is not None]
        self._killed: list[str] = []
        self._completed = 0
        self._began = time.monotonic()
        self._checked_at = self._began
        self._ticks = 0
        self._flushed_at = self._began
        self.announcer.on_block = self.kill_blockers
        subscribe(session, messages, self.safe_stop, self.calls)

    # --- one turn -------------------------------------------------------------------------

    def turn(self, check: Callable[[float], None]) -> None:
        """Take what arrives within a tick, release steps, and check what is due.

        check: of deadlines; gets the time since the last check [s].
        """
        clock = self.controls.real_time if self.state.phase.is_stepping else None
        is_slowed = self.state.phase.is_stepping and self.speed.factor is not None
        wait_s = self._longest_wait_s() if is_slowed else TICK_S
        if clock is not None:
            wait_s = clock.wait_s(self.state.released, wait_s)
        last = self.state.barrier.last() if self.state.phase.is_stepping else ()
        self.session.inbox.wake_for(last)
        self.session.inbox.receive(wait_s)
        self.release(always=clock is not None or is_slowed)
        self._flush_for_viewers()
        if self.controls.interrupt.is_set():
            raise Interrupted("interrupted by the user", step=self.state.barrier.completed)
        elapsed_s = time.monotonic() - self.state.away_s - self._checked_at
        if elapsed_s < TICK_S and not self.state.is_check_due:
            return
        self._checked_at += elapsed_s
        self.state.is_check_due = False
        # First who is dead: nobody is late who is.
        self._check_processes()
        check(min(elapsed_s, LONGEST_TICK_S))
        self._ticks += 1
        if self._ticks % _FLUSH_EVERY == 0:
            self.recorder.flush()
        if self._ticks % _PROGRESS_EVERY == 0:
            self.controls.observer.progress(self.progress())

    def _longest_wait_s(self) -> float:
        """Return how long to wait for messages in a run that is slowed down [s]."""
        return self.speed.wait_s(self.state.released, TICK_S)

    def _flush_for_viewers(self) -> None:
        """Write what is recorded as often as somebody who watches the run asks for."""
        period_s = self.steering.flush_s
        if period_s is not None and time.monotonic() - self._flushed_at >= period_s:
            self._flushed_at = time.monotonic()
            self.recorder.flush()

    def receive_for(self, duration_s: float) -> None:
        """Take what arrives within a time [s]; raises the first failure that is reported."""
        self.session.inbox.wake_for(())
        deadline = time.monotonic() + duration_s
        while time.monotonic() < deadline:
            self.session.inbox.receive(SHORT_TICK_S)

    def receive_after_failure(self, timeout_s: float) -> None:
        """Take what arrives; the run has ended already, a further failure changes nothing."""
        self.session.inbox.wake_for(())
        with contextlib.suppress(RunFailure):
            self.session.inbox.receive(timeout_s)

    # --- releasing steps ------------------------------------------------------------------

    def release(self, *, always: bool) -> None:
        """Release the steps that the newest outputs allow, and record those that are complete.

        always: also where no step has been completed since; a gate may have opened.
        """
        state = self.state
        completed = state.barrier.completed
        has_news = completed > self._completed or state.is_release_due or always
        if not state.phase.is_stepping or not has_news:
            return
        self._completed = completed
        state.is_release_due = False
        if self.controls.injector is not None:
            self.controls.injector.act(completed, state.participants)
        self.calls.act(state.released)
        self.strategy.peers.publish_below(state.barrier.step_limit, state.barrier.reported)
        self._send_trigger()
        self.safe_stop.follow(state.released)
        self.recorder.write_below(min(state.barrier.completed, state.last_step))

    def _send_trigger(self) -> None:
        released, clock = self.state.released, self.controls.real_time
        limit = step_limit(self.state.barrier, self._gates, released)
        if clock is not None:
            clock.follow(self.state, others=limit)
            limit = max(released, min(limit, clock.limit(released)))
        if limit > released:
            if clock is not None:
                clock.began(self.state, released, limit)
            self.state.released = limit
            self.announcer.trigger(limit)
            self.timing.trigger(limit)

    # --- processes ------------------------------------------------------------------------

    def _check_processes(self) -> None:
        """Raise for a process that has ended before the run (P10.4)."""
        if self.state.phase.is_stopping:
            return
        for participant in self.state.participants.values():
            if (
                participant.process.exit_code() is not None
                and participant.name != self.state.replaced
            ):
                raise self._death(participant)

    def _death(self, participant: ParticipantState) -> RunFailure:
        state = self.state
        details = (participant, state.participants, state.barrier, state.scenario.step_ns)
        if participant.name in self._killed:
            return took_nothing(*details)
        if participant.process.late is not None:
            return kept_thread(participant, participant.process.late, *details[1:])
        # A fault that it, or a witness, has reported is more precise, and is raised from here.
        self.receive_for(LAST_REPORTS_S)
        return death(*details)

    def kill_blockers(self) -> None:
        """Kill a process that reads nothing while a message to it blocks everything else.

        Called again while that frees nothing: then somebody else is the one.
        """
        participants = {
            name: participant
            for name, participant in self.state.participants.items()
            if participant.process.exit_code() is None
        }
        stopped = [
            name
            for name, participant in participants.items()
            if participant.process.activity().is_stopped
        ]
        holders = [name for name in self.state.barrier.holders() if name in participants]
        for name in stopped or holders or participants:
            self._killed.append(name)
            participants[name].process.signal(signal.SIGKILL)

    # --- the end --------------------------------------------------------------------------

    def stop(self, reason: str, at_step: int = -1) -> None:
        """Announce that the run ends; negative `at_step`: at once (P11)."""
        self.ended_at = time.monotonic()
        self.calls.close()
        self.announcer.stop(reason, at_step)

    def progress(self) -> Progress:
        """Return how far the run is."""
        state = self.state
        participants = state.participants.values()
        # Until the next step is due, a run in real time is held too.
        in_time = self.controls.real_time is not None
        in_time = (in_time or self.speed.factor is not None) and not self.pace.paused
        is_paused = state.phase.is_stepping and state.is_held and not in_time
        is_moving = state.phase.is_stepping and not is_paused
        return Progress(
            phase="paused" if is_paused else state.phase.shown,
            step=state.steps,
            steps=state.scenario.steps,
            step_ns=state.scenario.step_ns,
            elapsed_s=time.monotonic() - (state.started_at or self._began),
            phases={
                participant.name: participant.phase.name.lower() for participant in participants
            },
            compute_us={
                name: total / count * 1e-3 for name, (total, count) in state.compute.items()
            },
            drops={
                participant.name: sum(participant.drops.values()) for participant in participants
            },
            holders=tuple(state.barrier.holders()) if is_moving and not state.is_held else (),
            angles=measured_angles(state.scenario, self.descriptions, state.newest),
        )
