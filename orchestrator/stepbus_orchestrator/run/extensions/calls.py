"""Calls beside the step loop: made from outside, answered between two steps (P15)."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.errors import ExitCode, RunFailure, StepTimeout
from stepbus_orchestrator.recording import layout, recorded_decoder
from stepbus_orchestrator.run.bus import subscribe_named
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.failures import deadline, seconds
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_participant import Request, suggest
from stepbus_schemas import (
    Call,
    CallDescription,
    Called,
    CallRecord,
    CallReply,
    CallRequest,
    Decoder,
    MessageError,
    encode,
)

if TYPE_CHECKING:
    from stepbus_orchestrator.recording import Recording
    from stepbus_orchestrator.run.run import Run

CALL_KEY = "call"
_decode_request = Decoder(CallRequest)
_decode_called = Decoder(Called)
_REPEAT_S = 0.2
_LONGEST_CHECK_S = 0.25
"""One check counts for at most this long: a suspended orchestrator is nobody's fault (P12.1)."""

Reply = Callable[[CallReply], None]
Steer = Callable[[str, Sequence[Any]], CallReply]
"""Answers a call to the run itself: method and arguments."""


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """A call that waits for its turn. step: when; None: as soon as possible."""

    participant: str
    method: str
    args: list[Any]
    step: int | None
    reply: Reply


@dataclass
class _Open:
    """A call that has been sent and not been answered."""

    asked: _Asked
    message: Call
    step: int
    sent_at: float
    checked_at: float
    waited_s: float = 0.0


class Calls(RunExtension):
    """Makes the calls of users to participants, each before a step of the run.

    No participant is let into that step before the answer has come (P15.2). So a call is always
    answered between the same two steps, and what it changes is a function of its step: calls that
    change something are recorded, and made again by `rerun` and `replay`.

    planned: calls of a recording. new: further ones, each at its step; one that fails ends the run
    with a RunFailure. steer: answers calls to the run itself, which are not recorded. Methods run
    on the run's own thread.
    """

    def __init__(self, planned: Sequence[CallRecord] = (), new: Sequence[CallRecord] = ()) -> None:
        self._waiting: deque[_Asked] = deque(
            sorted(
                (
                    *(_planned(call, _no_reply) for call in planned),
                    *(_planned(call, partial(_insist, call)) for call in new),
                ),
                key=lambda asked: asked.step or 0,
            )
        )
        self._open: _Open | None = None
        self.steer: Steer = _no_steering
        self._number = 0

    def attach(self, run: "Run") -> None:
        """Listen to requests and answers."""
        super().attach(run)
        session, self._state = run.session, run.state
        self._token = session.token
        self._puts = {
            spec.name: session.announcer.publisher(f"call/{spec.name}", "Call/1")
            for spec in session.scenario.participants
        }
        subscribe_named(session, "called/*", self.take_called)
        session.bus.answer(CALL_KEY, session.inbox.into(self._take))

    def _take(self, request: Request) -> None:
        self.take_request(request.payload, partial(self.run.session.announcer.reply, request))

    def limit(self, released: int) -> int:
        """Return the step before which the next call is to be answered."""
        if self._open is not None:
            return self._open.step
        if not self._waiting:
            return FAR
        first = self._waiting[0].step
        return released if first is None else first

    def act(self) -> None:
        """Send the next call, when all steps before its own are complete; resend an open one.

        Raises StepTimeout when a participant has not answered within its deadline for a step.
        """
        if self._open is not None:
            self._check(self._open)
        elif self._waiting:
            asked = self._waiting[0]
            step = self._state.released if asked.step is None else asked.step
            if self._state.barrier.completed >= step:
                self._waiting.popleft()
                mistake = self._mistake(asked.participant, asked.method)
                if mistake is None:
                    self._send(asked, step)
                else:
                    asked.reply(CallReply(error=mistake))

    def _send(self, asked: _Asked, step: int) -> None:
        self._number += 1
        call = Call(token=self._token, id=self._number, method=asked.method, args=asked.args)
        now = self.run.clock.monotonic()
        self._open = _Open(asked=asked, message=call, step=step, sent_at=now, checked_at=now)
        self._puts[asked.participant](encode(call))

    def _check(self, call: _Open) -> None:
        now = self.run.clock.monotonic()
        call.waited_s += min(now - call.checked_at, _LONGEST_CHECK_S)
        call.checked_at = now
        participant = self._state.participants[call.asked.participant]
        if call.waited_s > seconds(participant.spec, "step"):
            raise StepTimeout(
                f"{self._state.at(call.step)}: {participant.who()} has not answered the call "
                f"{call.asked.method} for {call.waited_s:.1f} s; "
                f"{deadline(participant.spec, 'step')}",
                participant=participant.name,
                step=call.step,
            )
        if now - call.sent_at > _REPEAT_S:
            call.sent_at = now
            self._puts[participant.name](encode(call.message))

    def take_request(self, data: bytes, reply: Reply) -> None:
        """Take a user's request; one without the run's token is counted and not answered."""
        try:
            request = _decode_request(data)
        except MessageError:
            self._state.unauthenticated += 1
            return
        if request.token != self._token:
            self._state.unauthenticated += 1
            return
        if not request.participant:
            if request.method:
                reply(self.steer(request.method, request.args))
            else:
                reply(CallReply(value=self._offered()))
            return
        mistake = self._mistake(request.participant, request.method)
        if mistake is not None:
            reply(CallReply(error=mistake))
            return
        self._state.is_release_due = True
        self._waiting.append(
            _Asked(
                participant=request.participant,
                method=request.method,
                args=request.args,
                step=None,
                reply=reply,
            )
        )

    def _offered(self) -> dict[str, dict[str, Any]]:
        """Return all calls that participants offer: participant → method → its help."""
        return {
            name: {
                method: {"help": item.help, "changes": item.changes}
                for method, item in _methods(participant).items()
            }
            for name, participant in self._state.participants.items()
        }

    def _mistake(self, name: str, method: str) -> str | None:
        """Return why a call cannot be made, or None."""
        state = self._state
        if not state.phase.is_stepping:
            return f"the run is {state.phase.shown}; calls are answered between its steps"
        participant = state.participants.get(name)
        if participant is None:
            return f"no participant {name!r}{suggest(name, state.participants)}"
        methods = _methods(participant)
        if method not in methods:
            if not methods:
                return f"{name} offers no calls"
            return f"{name} has no call {method!r}{suggest(method, methods)}"
        return None

    def take_called(self, key_name: str, data: bytes) -> None:
        """Take an answer; one to another call than the open one is dropped (P15.3)."""
        try:
            called = _decode_called(data)
        except MessageError:
            self._state.unauthenticated += 1
            return
        call = self._open
        if called.token != self._token or called.name != key_name:
            self._state.unauthenticated += 1
        elif call is not None and (called.id, called.name) == (
            call.message.id,
            call.asked.participant,
        ):
            self._open = None
            self._state.is_release_due = True
            self._finish(call, called)

    def _finish(self, call: _Open, called: Called) -> None:
        asked = call.asked
        methods = _methods(self._state.participants[asked.participant])
        if asked.method in methods and methods[asked.method].changes:
            self.run.recorder.add_call(
                CallRecord(
                    step=call.step,
                    participant=asked.participant,
                    method=asked.method,
                    args=asked.args,
                    value=called.value,
                    error=called.error,
                )
            )
        asked.reply(CallReply(step=call.step, value=called.value, error=called.error))

    def stopping(self) -> None:
        """Answer every call that is left: there is no step it could be made before."""
        waiting = [*([self._open.asked] if self._open is not None else []), *self._waiting]
        self._open = None
        self._waiting.clear()
        for asked in waiting:
            asked.reply(CallReply(error="the run has ended"))


def _methods(participant: ParticipantState) -> dict[str, CallDescription]:
    return dict(participant.ready.calls) if participant.ready is not None else {}


def recorded_calls(recording: "Recording", participant: str | None = None) -> list[CallRecord]:
    """Return the calls that changed a recorded run, of one participant or of all.

    Raises MessageError for one that cannot be read.
    """
    decode = recorded_decoder(CallRecord)
    if layout.CALLS_TOPIC not in recording:
        return []
    calls = [decode(entry.data) for entry in recording[layout.CALLS_TOPIC].entries()]
    return [call for call in calls if participant in {None, call.participant}]


def _planned(call: CallRecord, reply: Reply) -> _Asked:
    return _Asked(
        participant=call.participant,
        method=call.method,
        args=call.args,
        step=call.step,
        reply=reply,
    )


def _insist(call: CallRecord, reply: CallReply) -> None:
    """End the run where a call has failed that it was started for."""
    if reply.error is not None:
        raise RunFailure(
            f"the call {call.participant} {call.method} before step {call.step}: {reply.error}",
            participant=call.participant,
            step=call.step,
            code=ExitCode.SCENARIO,
        )


def _no_steering(method: str, _args: Sequence[Any]) -> CallReply:
    return CallReply(error=f"this run has no call {method!r}")


def _no_reply(_reply: CallReply) -> None:
    """Drop the answer to a call that is made again."""
