"""Calls beside the step loop: made from outside, answered between two steps (P15)."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.errors import ExitCode, RunFailure, StepTimeout
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.bus import subscribe_named
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
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

CALL_KEY = "call"
_decode_request = Decoder(CallRequest)
_decode_called = Decoder(Called)
_REPEAT_S = 0.2
_LONGEST_CHECK_S = 0.25
"""One check counts at most this long: suspension is no participant's fault (P12.1)."""

Reply = Callable[[CallReply], None]
Steer = Callable[[str, Sequence[Any]], CallReply]
"""Answers a call to the run itself: method and arguments."""


@dataclass
class _Asked:
    """A call that waits for its turn, or its answer.

    step: before which it is made; None: as soon as possible, and then before step `at`. data: of
    the message, once it has been sent.
    """

    participant: str
    method: str
    args: list[Any]
    step: int | None
    reply: Reply
    at: int = 0
    data: bytes = b""
    sent_at: float = 0.0
    checked_at: float = 0.0
    waited_s: float = 0.0

    @classmethod
    def planned(cls, call: CallRecord, reply: Reply) -> "_Asked":
        """Return a call of a recording, or one that a run is started for."""
        return cls(call.participant, call.method, call.args, call.step, reply)


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
        calls = [_Asked.planned(call, lambda _reply: None) for call in planned]
        calls += [_Asked.planned(call, partial(_insist, call)) for call in new]
        self._waiting = deque(sorted(calls, key=lambda asked: asked.step or 0))
        self._open: _Asked | None = None
        self.steer: Steer = lambda method, _: CallReply(error=f"this run has no call {method!r}")
        self._number = 0

    def attach(self, run: RunView) -> None:
        """Listen to requests and answers."""
        super().attach(run)
        session, self._state = run.session, run.state
        self._token = session.token
        self._puts = {
            spec.name: session.publisher(f"call/{spec.name}", "Call/1")
            for spec in session.scenario.participants
        }
        subscribe_named(session, "called/*", self._take_called)
        session.bus.answer(CALL_KEY, session.inbox.into(self._take_request))

    def limit(self, released: int) -> int:
        """Return the step before which the next call is to be answered."""
        if self._open is not None:
            return self._open.at
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
            asked.at = self._state.released if asked.step is None else asked.step
            if self._state.barrier.completed >= asked.at:
                self._waiting.popleft()
                mistake = self._mistake(asked.participant, asked.method)
                if mistake is None:
                    self._send(asked)
                else:
                    asked.reply(CallReply(error=mistake))

    def _send(self, asked: _Asked) -> None:
        self._number += 1
        call = Call(token=self._token, id=self._number, method=asked.method, args=asked.args)
        asked.data = encode(call)
        asked.sent_at = asked.checked_at = self.run.clock.monotonic()
        self._open = asked
        self._puts[asked.participant](asked.data)

    def _check(self, asked: _Asked) -> None:
        now = self.run.clock.monotonic()
        asked.waited_s += min(now - asked.checked_at, _LONGEST_CHECK_S)
        asked.checked_at = now
        participant = self._state.participants[asked.participant]
        if asked.waited_s > participant.limit_s("step"):
            raise self._state.failure(
                StepTimeout,
                participant,
                asked.at,
                f"has not answered the call {asked.method} for {asked.waited_s:.1f} s; "
                f"deadline {participant.limit('step')}",
            )
        if now - asked.sent_at > _REPEAT_S:
            asked.sent_at = now
            self._puts[participant.name](asked.data)

    def _take_request(self, request: Request) -> None:
        """Take a user's request; one without the run's token is counted and not answered."""
        try:
            asked = _decode_request(request.payload)
        except MessageError:
            self._state.unauthenticated += 1
            return
        if asked.token != self._token:
            self._state.unauthenticated += 1
            return
        reply = partial(self.run.session.reply, request)
        if asked.participant:
            mistake = self._mistake(asked.participant, asked.method)
            if mistake is not None:
                reply(CallReply(error=mistake))
                return
            self._state.is_release_due = True
            self._waiting.append(_Asked(asked.participant, asked.method, asked.args, None, reply))
        elif asked.method:
            reply(self.steer(asked.method, asked.args))
        else:
            reply(CallReply(value=self._offered()))

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
                return f"{name} does not accept calls"
            return f"{name} has no call {method!r}{suggest(method, methods)}"
        return None

    def _take_called(self, key_name: str, data: bytes) -> None:
        """Take an answer; one to another call than the open one is dropped (P15.3)."""
        asked = self._open
        sent = self.run.messages.sender(_decode_called, data, key_name)
        if asked is not None and sent is not None:
            participant, called = sent
            if (called.id, called.name) == (self._number, asked.participant):
                self._open = None
                self._state.is_release_due = True
                self._finish(asked, participant, called)

    def _finish(self, asked: _Asked, participant: ParticipantState, called: Called) -> None:
        methods = _methods(participant)
        if asked.method in methods and methods[asked.method].changes:
            self.run.recorder.add_call(
                CallRecord(
                    step=asked.at,
                    participant=asked.participant,
                    method=asked.method,
                    args=asked.args,
                    value=called.value,
                    error=called.error,
                )
            )
        asked.reply(CallReply(step=asked.at, value=called.value, error=called.error))

    def stopping(self) -> None:
        """Answer every call that is left: there is no step it could be made before."""
        waiting = [*([] if self._open is None else [self._open]), *self._waiting]
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
    decode = Decoder(CallRecord)
    if layout.CALLS_TOPIC not in recording:
        return []
    calls = [decode(entry.data) for entry in recording[layout.CALLS_TOPIC].entries()]
    return [call for call in calls if participant in {None, call.participant}]


def _insist(call: CallRecord, reply: CallReply) -> None:
    """End the run where a call has failed that it was started for."""
    if reply.error is not None:
        raise RunFailure(
            f"the call {call.participant} {call.method} before step {call.step}: {reply.error}",
            participant=call.participant,
            step=call.step,
            code=ExitCode.SCENARIO,
        )
