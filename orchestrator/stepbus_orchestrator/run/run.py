"""A run while it lasts: one wait, one check of deadlines and processes, one release."""

import contextlib
import signal
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import Interrupted, RunFailure
from stepbus_orchestrator.recording import Descriptions, Sink, TimingRecorder
from stepbus_orchestrator.run.bus import Session, subscribe
from stepbus_orchestrator.run.kernel.barrier import Gate, step_limit
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.repeats import Repeats
from stepbus_orchestrator.run.reports import Observer, Progress, progress_of
from stepbus_orchestrator.run.safe_stop import SafeStop
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_schemas import Message, reached

from .extension import RunExtension, overriding
from .host import Strategy
from .kernel.failures import death, kept_thread, took_nothing
from .kernel.messages import MessageHandler
from .kernel.participants import ParticipantState

TICK_S = 0.05
SHORT_TICK_S = TICK_S / 5
LONGEST_TICK_S = 0.25
"""One check counts at most this long: a machine that slept is no participant's fault (P12.1)."""
_LAST_REPORTS_S = 0.1
"""Participants that wait for a dead process report after 20 ms at which step (P9.2, P9.3)."""
_LATE_REPORTS_S = 1.0
"""The same on a busy machine, where one of them has not."""

_PROGRESS_EVERY = 5
_FLUSH_EVERY = 4
"""In ticks: a kill -9 costs at most 0.25 s of the recording, and what is in flight."""


class Run:
    """A run, from the start of its participants to their end; `phases.run_phases` drives it.

    session: its end of the bus. strategy: how it gets its participants. recorder: gets their
    outputs. timing: gets what the clock shows. out: folder of the run. observer: is notified of
    progress. interrupt: ends the run when it is set. extensions: its features.

    state: how far it is. messages: takes what participants send. gates: hold steps. descriptions:
    of all outputs, from the end of the start-up on. killed: those that read nothing, and blocked
    all others. ended_at: when the stop was sent, by the monotonic clock [s]. is_recorded: whether
    the recorder has been asked to finish, so that it must not be asked to abort. is_timed: whether
    the clock says when steps begin.
    """

    def __init__(
        self,
        session: Session,
        strategy: Strategy,
        recorder: Sink,
        timing: TimingRecorder,
        *,
        out: Path,
        observer: Observer | None = None,
        interrupt: threading.Event | None = None,
        extensions: Sequence[RunExtension] = (),
    ) -> None:
        self.state = RunState(session.scenario)
        self.session = session
        self.strategy = strategy
        self.recorder = recorder
        self.announcer = session.announcer
        self.clock = session.bus.clock
        self.timing = timing
        self.out = out
        self.observer = observer or Observer()
        self.interrupt = interrupt or threading.Event()
        self.extensions = extensions
        self.descriptions: Descriptions = {}
        self.ended_at = 0.0
        self.is_recorded = False
        self.messages = MessageHandler(
            self.state,
            session.token,
            recorder,
            timing,
            take_slots=strategy.slots.take,
        )
        self.safe_stop = SafeStop(session, self.state, self.messages)
        self.repeats = Repeats(session, self.state, self.messages, timing)
        # A step calls only the extensions that have something to do in it.
        self.gates: list[Gate] = overriding(extensions, "limit")
        self._turns = overriding(extensions, "turn")
        self._acts = overriding(extensions, "act")
        self._completions = overriding(extensions, "completed")
        self._releases = overriding(extensions, "released")
        self._waits = overriding(extensions, "wait_s")
        self.is_timed = False
        self._completed = 0
        self._looked_at = 0
        self._began = self.clock.monotonic()
        self._checked_at = self._began
        self._ticks = 0
        self.killed: list[str] = []
        self.announcer.on_block = self._kill_blockers
        for extension in extensions:
            extension.attach(self)
        subscribe(session, self.messages, self.safe_stop.followed)

    # --- one turn -------------------------------------------------------------------------

    def turn(self, check: Callable[[float], None]) -> None:
        """Take what arrives within a tick, release steps, and check what is due.

        check: of deadlines; gets the time since the last check [s].
        """
        wait_s = self._longest_wait_s() if self.state.phase.is_stepping else TICK_S
        last = self.state.barrier.last() if self.state.phase.is_stepping else ()
        self.session.inbox.wake_for(last)
        self.session.inbox.receive(wait_s)
        self.release(always=self.is_timed)
        for turn in self._turns:
            turn()
        if self.interrupt.is_set():
            reached("a run is interrupted")
            raise Interrupted("interrupted by the user", step=self.state.barrier.completed)
        elapsed_s = self.clock.monotonic() - self.state.away_s - self._checked_at
        if elapsed_s < TICK_S and not self.state.is_check_due:
            return
        self._checked_at += elapsed_s
        self.state.is_check_due = False
        # First the dead: a dead participant is not late.
        self._check_processes()
        check(min(elapsed_s, LONGEST_TICK_S))
        self._ticks += 1
        if self._ticks % _FLUSH_EVERY == 0:
            self.recorder.flush()
        if self._ticks % _PROGRESS_EVERY == 1:
            self.observer.progress(self.progress())

    def _longest_wait_s(self) -> float:
        """Return how long to wait for messages, where the clock may release a step [s]."""
        waits = [wait(self.state.released, TICK_S) for wait in self._waits]
        timed = [wait_s for wait_s in waits if wait_s is not None]
        self.is_timed = bool(timed)
        return min(timed, default=TICK_S)

    def receive_for(self, duration_s: float) -> None:
        """Take what arrives within a time [s]; raises the first failure that is reported."""
        # No tick does so meanwhile.
        self.recorder.flush()
        self.session.inbox.wake_for(())
        deadline = self.clock.monotonic() + duration_s
        while self.clock.monotonic() < deadline:
            self.session.inbox.receive(SHORT_TICK_S)

    def receive_last_reports(self, name: str) -> None:
        """Take what is still under way when a process has ended; raises what that reports.

        name: of its participant. Its readers say at which step they wait for it.
        """
        self.receive_for(_LAST_REPORTS_S)
        state, give_up = self.state, self.clock.monotonic() + _LATE_REPORTS_S
        while state.phase.is_stepping and not state.is_awaited(name):
            if self.clock.monotonic() > give_up:
                return
            self.session.inbox.receive(SHORT_TICK_S)

    def receive_after_failure(self, timeout_s: float) -> None:
        """Take what arrives; the run has ended already, a further failure changes nothing."""
        self.session.inbox.wake_for(())
        with contextlib.suppress(RunFailure):
            self.session.inbox.receive(timeout_s)

    # --- processes ------------------------------------------------------------------------

    def _check_processes(self) -> None:
        """Raise for a process that has ended before the run (P10.4)."""
        if self.state.phase.is_stopping:
            return
        for name, participant in self.state.participants.items():
            process = participant.process
            if process.exit_code() is None or name == self.state.replaced:
                continue
            if name in self.killed:
                raise took_nothing(self.state, participant)
            if process.late is not None:
                raise kept_thread(self.state, participant, process.late)
            # A fault that it, or a witness, has reported is more precise, and is raised from here.
            self.receive_last_reports(name)
            raise death(self.state, participant)

    def _kill_blockers(self) -> None:
        """Kill a process that reads nothing while a message to it blocks everything else.

        Called on the watchdog's thread, and again while that frees nothing: then it is another.
        """
        reached("a put is blocked")
        processes = {
            name: participant.process
            for name, participant in self.state.participants.items()
            if participant.process.exit_code() is None
        }
        stopped = [name for name, item in processes.items() if item.activity().is_stopped]
        holders = [name for name in self.state.barrier.holders() if name in processes]
        for name in stopped or holders or processes:
            self.killed.append(name)
            processes[name].signal(signal.SIGKILL)

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
        for act in self._acts:
            act()
        if self._completions:
            self._look_at_completed()
        self._send_trigger()
        self.safe_stop.follow(state.released)
        self.recorder.write_below(min(state.barrier.completed, state.last_step))

    def _look_at_completed(self) -> None:
        completed = min(self.state.barrier.completed, self.state.last_step)
        while self._looked_at < completed:
            for look in self._completions:
                look(self._looked_at)
            self._looked_at += 1

    def _send_trigger(self) -> None:
        released = self.state.released
        limit = step_limit(self.state.barrier, self.gates, released)
        if limit > released:
            for begin in self._releases:
                begin(released, limit)
            self.state.released = limit
            self.announcer.trigger(limit)
            self.timing.trigger(limit)

    # --- what extensions and hosts do ---------------------------------------------------------

    def start_options(self, spec: ParticipantSpec) -> dict[str, Any]:
        """Return how a participant is to be started, as far as extensions say so."""
        options: dict[str, Any] = {}
        for extension in self.extensions:
            options |= extension.start_options(spec)
        return options

    def started(self, participant: ParticipantState) -> None:
        """Take a participant that has been started."""
        self.state.participants = {**self.state.participants, participant.name: participant}
        for extension in self.extensions:
            extension.started(participant)

    def newest(self, output: str) -> Message | None:
        """Return the newest message of an output, such as `plant.joint_state`; None before one.

        Raises WiringError for an output that the scenario does not have, or whose messages are
        bulk, MessageError for a message that is not of its type.
        """
        return self.state.newest_message(output)

    def end(self, reason: str) -> None:
        """End the run behind the steps that are released; an extension's `completed` may ask so."""
        self.state.ask_end(self.state.released, reason)

    def stop(self, reason: str, at_step: int = -1) -> None:
        """Announce that the run ends; negative `at_step`: at once (P11)."""
        self.ended_at = self.clock.monotonic()
        for extension in self.extensions:
            extension.stopping()
        self.announcer.stop(reason, at_step)

    def progress(self) -> Progress:
        """Return how far the run is."""
        # Until the next step is due by the clock, a run is held too.
        is_held = not self.is_timed or any(item.is_holding() for item in self.extensions)
        elapsed_s = self.clock.monotonic() - (self.state.started_at or self._began)
        return progress_of(self.state, self.descriptions, elapsed_s, is_held=is_held)
