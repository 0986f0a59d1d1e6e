"""A run, from the start of its participants to their end (P4, P5, P11)."""

import contextlib
import signal
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import Interrupted, ParticipantDied, RunFailure, StopTimeout
from stepbus_orchestrator.processes.child import TERM_GRACE_S
from stepbus_orchestrator.processes.endpoints import new_token
from stepbus_orchestrator.recording import Descriptions, Sink, TimingRecorder
from stepbus_orchestrator.run.bus import Session, subscribe
from stepbus_orchestrator.run.kernel.admission import batches_of
from stepbus_orchestrator.run.kernel.barrier import Gate, step_limit
from stepbus_orchestrator.run.kernel.descriptions import check_descriptions, input_descriptions
from stepbus_orchestrator.run.kernel.state import RunPhase, RunState
from stepbus_orchestrator.run.repeats import Repeats
from stepbus_orchestrator.run.reports import Observer, Progress, progress_of
from stepbus_orchestrator.scenario.model import Deadlines, ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import Bus, suggest
from stepbus_schemas import Decoder, Message, Start, WiringError, encode, reached

from .extension import Host, RunExtension, Strategy, overriding
from .kernel.deadlines import check_bulk, check_closing, check_start, check_step
from .kernel.failures import death
from .kernel.messages import MessageHandler
from .kernel.participants import ParticipantState, Phase

TICK_S = 0.05
SHORT_TICK_S = TICK_S / 5
LONGEST_TICK_S = 0.25
"""One check counts at most this long: a machine that slept is no participant's fault (P12.1)."""
_LAST_REPORTS_S = 0.1
"""Participants that wait for a dead process report after 20 ms at which step (P9.2, P9.3)."""
_LATE_REPORTS_S = 1.0
"""The same on a busy machine, where one of them has not."""
_LAST_S = 0.5
"""How long the last messages of a process may come after its end [s]."""
_OWN_WORK_S = 60.0
"""How long a program that has left a complete run may work on, to save a plot for example [s]."""
_LEAVE_S = 1.0
"""How long a run that has failed waits for a process that the user has started [s]."""

_PROGRESS_EVERY = 5
_FLUSH_EVERY = 4
"""In ticks: a kill -9 costs at most 0.25 s of the recording, and what is in flight."""


class Run:
    """One run, as extensions see it in `RunView`; `take_place` goes through its phases.

    extensions: its features. is_attached: whether it has
    been on the bus. ended_at: when the stop was sent, by the monotonic clock [s]. is_recorded:
    whether the recorder has been asked to finish, so that it must not be asked to abort.
    """

    def __init__(
        self,
        scenario: Scenario,
        recorder: Sink,
        timing: TimingRecorder,
        *,
        out: Path,
        observer: Observer | None = None,
        interrupt: threading.Event | None = None,
        extensions: Sequence[RunExtension] = (),
        warn: Callable[[str, str], None] = lambda _name, _text: None,
        result: Callable[[], bytes] = bytes,
    ) -> None:
        self.key, self.token = new_token(), new_token()
        self.state = RunState(scenario)
        self.recorder = recorder
        self.timing = timing
        self.out = out
        self.observer = observer or Observer()
        self.interrupt = interrupt or threading.Event()
        self.extensions = extensions
        self.warn = warn
        self.result = result
        self.descriptions: Descriptions = {}
        self.ended_at = 0.0
        self.is_recorded = False
        # A step calls only the extensions that have something to do in it.
        self.gates: list[Gate] = overriding(extensions, "limit")
        self._turns = overriding(extensions, "turn")
        self._acts = overriding(extensions, "act")
        self._completions = overriding(extensions, "completed")
        self._waits = overriding(extensions, "wait_s")
        self.is_attached = self.is_timed = False
        self._decoders: dict[str, Callable[[bytes], Message]] = {}
        self._completed = 0
        self._looked_at = 0
        self._ticks = 0

    def take_place(self, host: Host) -> str:
        """Go through all phases on a host, and return why the run ended.

        Every process is ended, whatever happens. Raises RunFailure when the run ends before its
        time, or a participant does not end as it should.
        """
        with host.open(self) as (bus, strategy):
            self.attach(bus, strategy)
            try:
                return self._go_through_phases()
            finally:
                for extension in self.extensions:
                    extension.close()

    def attach(self, bus: Bus, strategy: Strategy) -> None:
        """Listen to the bus, and let extensions attach; no participant has started."""
        self.strategy = strategy
        self.clock = bus.clock
        self._began = self._checked_at = self.clock.monotonic()
        session = self.session = Session(self.state.scenario, bus, self.token, self._kill_blockers)
        self.messages = MessageHandler(
            self.state, self.token, self.recorder, self.timing, take_slots=strategy.slots.take
        )
        self._repeats = Repeats(self)
        for extension in self.extensions:
            extension.attach(self)
        self.is_attached = True
        subscribe(session, self.messages)

    def _go_through_phases(self) -> str:
        failure: RunFailure | None = None
        try:
            failure = self._until_shutdown()
        except BaseException:
            self.stop("the orchestrator ends")
            raise
        finally:
            self.state.enter(RunPhase.SHUTDOWN)
            late = self._shut_down(failure)
        if failure is not None:
            raise failure
        self._check_ends(late)
        return self.state.reason

    def _until_shutdown(self) -> RunFailure | None:
        """Go through the phases before the shutdown; return what ends the run before its time."""
        failure: RunFailure | None = None
        try:
            self._start_up()
            self.state.enter(RunPhase.STEPPING)
            try:
                self._step()
            except RunFailure as exc:
                failure = exc
                outcome = self._survive(exc)
                self._step()
            self.state.enter(RunPhase.CLOSING)
            self._close()
            if failure is not None:
                failure = _extended(failure, outcome(), failure)
        except RunFailure as exc:
            if failure is not None and failure is not exc:
                reached("something fails while a participant is replaced")
                failure = _extended(failure, f"while its commands were held: {exc}", exc)
            failure = failure or exc
        if failure is not None:
            self.stop(str(failure))
        return failure

    # --- start-up -------------------------------------------------------------------------

    def _start_up(self) -> None:
        """Start every participant, wait until all are ready, and publish the `Start`."""
        state = self.state
        self.strategy.launch(self)
        while not state.is_ready:
            for extension in self.extensions:
                extension.awaiting(state.participants.values())
            self._turn(lambda elapsed_s: check_start(state, elapsed_s))
        ready = {one.name: one.ready for one in state.participants.values() if one.ready}
        outputs = {name: dict(item.outputs) for name, item in ready.items()}
        self.descriptions = {**self.descriptions, **outputs}
        inputs = input_descriptions(state.scenario, self.descriptions)
        check_descriptions(state.participants, inputs)
        versions = {name: dict(item.versions) for name, item in ready.items()}
        self.recorder.open_channels(self.descriptions, versions)
        batches = {} if state.is_repeating else batches_of(state.scenario, state.participants)
        slots = self.strategy.slots.agree(ready)
        if self.strategy.has_links:
            state.check_bulk(slots)
        message = encode(Start(token=self.token, inputs=inputs, batches=batches, slots=slots))
        state.check_size("the descriptions of all inputs", message)
        for extension in self.extensions:
            extension.ready()
        self.timing.event("start")
        state.started_at = self.clock.monotonic()
        self.session.start(message)

    # --- stepping and closing -------------------------------------------------------------

    def _step(self) -> None:
        """Release step after step until the last one is complete."""
        state, barrier = self.state, self.state.barrier
        self._release(always=True)
        while not state.is_complete:
            before = barrier.count
            self._turn(self._check)
            if barrier.count == before:
                # A participant may have missed it: it was published before the link was complete.
                self.session.repeat(with_start=not barrier.has_all_started)

    def _check(self, elapsed_s: float) -> None:
        self._release(always=True)
        # No participant is late while a gate holds the run.
        if not self.state.is_held:
            check_step(self.state, elapsed_s)
            self._repeats.look(self.state.barrier.holders(), "step")

    def _close(self) -> None:
        """Ask for the closing outputs (P11.3), and finish the recording after them."""
        state, end = self.state, self.state.last_step
        schedule = Schedule(state.scenario)
        state.closing = [name for name in schedule.order if schedule.closing(name, end)]
        self.stop(state.reason, at_step=end)
        while state.holders():
            self._turn(self._check_closing)
        began = self.clock.monotonic()
        while self.recorder.owing_bulk():
            self._turn(
                lambda _: check_bulk(
                    state, self.recorder.owing_bulk(), self.clock.monotonic() - began
                )
            )
        self.is_recorded = True
        self.recorder.finish(end, state.closing)

    def _check_closing(self, elapsed_s: float) -> None:
        check_closing(self.state, elapsed_s)
        self.session.repeat_stop()
        self._repeats.look(self.state.holders(), "stop")

    def _survive(self, failure: RunFailure) -> Callable[[], str]:
        """Have an extension keep the run going; raises the failure where none does."""
        for extension in self.extensions:
            if (outcome := extension.survive(failure)) is not None:
                return outcome
        raise failure

    # --- shutdown -------------------------------------------------------------------------

    def _shut_down(self, failure: RunFailure | None) -> list[ParticipantState]:
        """End every process, take what is still reported, and return those that were late.

        Each has its stop deadline. The run does not wait for the culprit, nor for a participant
        that is not ready: it has nothing to save.
        """
        participants = self.state.participants
        culprit = participants.get(failure.participant or "") if failure is not None else None
        if culprit is not None and culprit.external is None:
            # Before the others: a process that reads nothing blocks those that publish to it.
            culprit.process.end()
        waits_for = [
            one
            for one in participants.values()
            if one.phase == Phase.READY
            and (one is not culprit or one.external is not None)
            # In a run that has failed, one that is stopped as well would only be waited for.
            and not (failure is not None and one.process.activity().is_stopped)
        ]
        late = self._await_ends(waits_for, has_failed=failure is not None)
        for one in participants.values():
            one.process.terminate()
        # They share the grace between the two signals.
        give_up = self.clock.monotonic() + TERM_GRACE_S
        for one in participants.values():
            one.process.end(max(0.0, give_up - self.clock.monotonic()))
        # What they published before they ended may arrive after their exit codes.
        give_up = self.clock.monotonic() + _LAST_S
        self._receive_after_failure(0.0)
        while self.clock.monotonic() < give_up and not all(
            one.has_left or one.external is not None for one in waits_for
        ):
            self._receive_after_failure(SHORT_TICK_S)
        self.session.close()
        return late

    def _await_ends(
        self, participants: list[ParticipantState], *, has_failed: bool
    ) -> list[ParticipantState]:
        began = self.clock.monotonic()
        while True:
            left = [one for one in participants if one.process.exit_code() is None]
            waited_s = self.clock.monotonic() - began
            if not any(waited_s < self._patience_s(one, has_failed=has_failed) for one in left):
                return left
            for extension in self.extensions:
                extension.awaiting(left)
            self.session.repeat_stop()
            self._receive_after_failure(SHORT_TICK_S)

    def _patience_s(self, participant: ParticipantState, *, has_failed: bool) -> float:
        """Return how long a participant may take to end [s]; not long after Ctrl-C."""
        if has_failed and participant.external is not None:
            # It may stand in a debugger, and is not ours to end.
            return _LEAVE_S
        stop_s = participant.limit_s("stop")
        if self.interrupt.is_set():
            return min(stop_s, Deadlines.stop_s)
        return max(stop_s, _OWN_WORK_S) if participant.is_on_its_own and not has_failed else stop_s

    def _check_ends(self, late: list[ParticipantState]) -> None:
        """Raise for a participant that did not end in time, or with another exit code than 0."""
        participants = self.state.participants.values()
        late += [one for one in participants if one.process.late or one.took_nothing]
        if late:
            reached("a participant is late to end")
            first = late[0]
            key, limit_s = "stop", self._patience_s(first, has_failed=False)
            what = f"did not end within {limit_s:g} s of the stop"
            if first.took_nothing:
                key, limit_s = "step", first.limit_s("step")
                what = f"read no messages for {limit_s:g} s while they queued up, at the stop,"
            raise StopTimeout(
                (
                    f"{', '.join(one.who() for one in late)} {what} and was "
                    f"{'killed' if first.external is None else 'left running'} "
                    f"(participants.{first.name}.{key}_timeout); the recording is complete"
                ),
                participant=first.name,
                step=self.state.steps,
            )
        for one in participants:
            if one.process.exit_code() != 0:
                reached("a participant ends with an error after the last step")
                raise ParticipantDied(
                    f"after the last step: {one.who()} {one.process.how_it_ended()} while "
                    f"stopping; the recording is complete; {one.where_it_prints()}",
                    participant=one.name,
                    step=self.state.steps,
                )

    # --- one turn -------------------------------------------------------------------------

    def _turn(self, check: Callable[[float], None]) -> None:
        """Take what arrives within a tick, release steps, and check what is due.

        check: of deadlines; gets the time since the last check [s].
        """
        wait_s = self._longest_wait_s() if self.state.phase.is_stepping else TICK_S
        last = self.state.barrier.last() if self.state.phase.is_stepping else ()
        self.session.inbox.wake_for(last)
        self.session.inbox.receive(wait_s)
        self._release(always=self.is_timed)
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

    def _receive_for(self, duration_s: float) -> None:
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
        self._receive_for(_LAST_REPORTS_S)
        state, give_up = self.state, self.clock.monotonic() + _LATE_REPORTS_S
        while state.phase.is_stepping and not state.is_awaited(name):
            if self.clock.monotonic() > give_up:
                return
            self.session.inbox.receive(SHORT_TICK_S)

    def _receive_after_failure(self, timeout_s: float) -> None:
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
            if not (participant.took_nothing or process.late):
                # A fault that it, or a witness, has reported is more precise, and is raised here.
                self.receive_last_reports(name)
            raise death(self.state, participant)

    def _kill_blockers(self) -> None:
        """Kill a process that reads nothing while a message to it blocks everything else.

        Called on the watchdog's thread, and again while that frees nothing: then it is another.
        """
        reached("a put is blocked")
        running = [
            one for one in self.state.participants.values() if one.process.exit_code() is None
        ]
        stopped = [one for one in running if one.process.activity().is_stopped]
        holders = [one for one in running if one.name in self.state.holders()]
        for one in stopped or holders or running:
            one.took_nothing = True
            one.process.signal(signal.SIGKILL)

    # --- releasing steps ------------------------------------------------------------------

    def _release(self, *, always: bool) -> None:
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
            self.state.released = limit
            self.session.trigger(limit)
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
        name, _, port = output.partition(".")
        if output not in self._decoders:
            self._decoders[output] = self._decoder(output)
        raw = self.state.newest.get(name, {}).get(port)
        return None if raw is None else self._decoders[output](bytes(raw))

    def _decoder(self, output: str) -> Callable[[bytes], Message]:
        scenario = self.state.scenario
        types = {
            f"{spec.name}.{port}": described.type
            for spec in scenario.participants
            for port, described in spec.outputs.items()
            if not described.bulk
        }
        if output not in types:
            raise WiringError(f"no output {output!r}{suggest(output, types)}")
        return Decoder(scenario.types[types[output]])

    def end(self, reason: str) -> None:
        """End the run after the steps that are released; an extension's `completed` may ask so."""
        self.state.ask_end(self.state.released, reason)

    def stop(self, reason: str, at_step: int = -1) -> None:
        """Announce that the run ends; negative `at_step`: at once (P11)."""
        self.ended_at = self.clock.monotonic()
        for extension in self.extensions:
            extension.stopping()
        self.session.stop(reason, at_step)

    def progress(self) -> Progress:
        """Return how far the run is."""
        # Until the next step is due by the clock, a run is held too.
        is_held = not self.is_timed or self.state.is_paused
        elapsed_s = self.clock.monotonic() - (self.state.started_at or self._began)
        return progress_of(self.state, self.descriptions, elapsed_s, is_held=is_held)


def _extended(failure: RunFailure, text: str, cause: RunFailure) -> RunFailure:
    extended = type(failure)(
        f"{failure}; {text}", participant=failure.participant, step=failure.step
    )
    extended.__cause__ = cause
    return extended
