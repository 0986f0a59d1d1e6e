"""Calls beside the step loop: asked from outside, answered between two steps."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from stepbus_orchestrator.errors import StepTimeout
from stepbus_orchestrator.recording import Recording, Sink, layout
from stepbus_orchestrator.run.kernel.deadlines import at
from stepbus_orchestrator.run.kernel.messages import RunState
from stepbus_orchestrator.run.kernel.participants import Member
from stepbus_participant import Bus, suggest
from stepbus_schemas import (
    Call,
    Called,
    CallRecord,
    CallReply,
    CallRequest,
    Decoder,
    MessageError,
    encode,
    encoding_of,
)

from .pace import FAR

CALL_KEY = "call"
_decode_request = Decoder(CallRequest)
_decode_called = Decoder(Called)
_REPEAT_S = 0.2


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """A call that waits for its turn. step: when; None: as soon as possible. reply: to whom."""

    participant: str
    method: str
    args: list[Any]
    step: int | None
    reply: Callable[[CallReply], None]


@dataclass
class _Open:
    """A call that has been sent and not been answered."""

    asked: _Asked
    message: Call
    step: int
    sent_at: float
    began_at: float


class Calls:
    """Asks participants what somebody outside wants to know, each before a step of the run.

    Nobody is let into that step before the answer is there. So it is always given between the same
    two steps, and what a call changes is a function of its step: those that say they change
    something are recorded, and done again by `rerun` and `replay`.

    planned: calls of a recording. Methods run on the conductor's thread.
    """

    def __init__(
        self,
        *,
        state: RunState,
        bus: Bus,
        token: str,
        recorder: Sink,
        planned: Sequence[CallRecord] = (),
    ) -> None:
        self._state = state
        self._bus = bus
        self._token = token
        self._recorder = recorder
        self._waiting: deque[_Asked] = deque(
            _Asked(
                participant=call.participant,
                method=call.method,
                args=call.args,
                step=call.step,
                reply=_nobody,
            )
            for call in planned
        )
        self._open: _Open | None = None
        self._number = 0
        self._puts = {
            spec.name: bus.publisher(f"call/{spec.name}", encoding_of("Call/1"))
            for spec in state.scenario.participants
        }

    def limit(self, released: int) -> int:
        """Return the step before which the next call is to be answered."""
        if self._open is not None:
            return self._open.step
        if not self._waiting:
            return FAR
        first = self._waiting[0].step
        return released if first is None else first

    def act(self, released: int) -> None:
        """Send the next call, when all steps before its own are complete; repeat an open one.

        Raises StepTimeout when somebody has not answered within its deadline for a step.
        """
        completed = self._state.barrier.completed
        if self._open is not None:
            self._urge(self._open)
        elif self._waiting:
            asked = self._waiting[0]
            step = released if asked.step is None else asked.step
            if completed >= step:
                self._waiting.popleft()
                self._send(asked, step)

    def _send(self, asked: _Asked, step: int) -> None:
        self._number += 1
        call = Call(token=self._token, id=self._number, method=asked.method, args=asked.args)
        now = time.monotonic()
        self._open = _Open(asked=asked, message=call, step=step, sent_at=now, began_at=now)
        self._puts[asked.participant](encode(call))

    def _urge(self, call: _Open) -> None:
        now = time.monotonic()
        member = self._state.roster[call.asked.participant]
        deadline_s = member.spec.deadlines.step_s
        if now - call.began_at > deadline_s:
            raise StepTimeout(
                f"{at(call.step, self._state.scenario.step_ns)}: {member.who()} has not answered "
                f"the call {call.asked.method} for {now - call.began_at:.1f} s; deadline "
                f"{deadline_s:g} s (participants.{member.name}.step_timeout)",
                participant=member.name,
                step=call.step,
            )
        if now - call.sent_at > _REPEAT_S:
            call.sent_at = now
            self._puts[member.name](encode(call.message))

    def take_request(self, query: Any) -> None:
        """Take in what somebody asks; one without the run's token is a stranger."""
        try:
            request = _decode_request(query.payload)
        except MessageError:
            self._state.unauthenticated += 1
            return
        if request.token != self._token:
            self._state.unauthenticated += 1
            return

        def reply(answer: CallReply) -> None:
            query.reply(encode(answer), encoding_of("CallReply/1"))

        if not request.participant:
            reply(CallReply(value=self._offered()))
            return
        mistake = self._mistake(request)
        if mistake is not None:
            reply(CallReply(error=mistake))
            return
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
        """Return what everybody can be asked: participant → method → its help."""
        return {
            name: {
                method: {"help": item.help, "changes": item.changes}
                for method, item in self._methods(member).items()
            }
            for name, member in self._state.roster.items()
        }

    def _methods(self, member: Member) -> dict[str, Any]:
        return dict(member.ready.calls) if member.ready is not None else {}

    def _mistake(self, request: CallRequest) -> str | None:
        """Return why a call cannot be made, or None."""
        if self._state.phase != "stepping":
            return f"the run is {self._state.phase}; calls are answered between its steps"
        member = self._state.roster.get(request.participant)
        if member is None:
            name = request.participant
            return f"no participant {name!r}{suggest(name, self._state.roster)}"
        methods = self._methods(member)
        if request.method not in methods:
            if not methods:
                return f"{member.name} offers no calls"
            return f"{member.name} has no call {request.method!r}{suggest(request.method, methods)}"
        return None

    def take_called(self, sample: Any) -> None:
        """Take in an answer."""
        try:
            called = _decode_called(self._bus.payload(sample))
        except MessageError:
            self._state.unauthenticated += 1
            return
        call = self._open
        key_name = self._bus.key(sample).rpartition("/")[2]
        if called.token != self._token or called.name != key_name:
            self._state.unauthenticated += 1
        elif (
            call is not None
            and called.id == call.message.id
            and called.name == call.asked.participant
        ):
            self._open = None
            self._finish(call, called)

    def _finish(self, call: _Open, called: Called) -> None:
        asked = call.asked
        methods = self._methods(self._state.roster[asked.participant])
        if asked.method in methods and methods[asked.method].changes:
            self._recorder.add_call(
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

    def close(self) -> None:
        """Tell everybody who waits that there will be no answer."""
        waiting = [*([self._open.asked] if self._open is not None else []), *self._waiting]
        self._open = None
        self._waiting.clear()
        for asked in waiting:
            asked.reply(CallReply(error="the run has ended"))


def recorded_calls(recording: Recording, participant: str | None = None) -> list[CallRecord]:
    """Return the calls that changed a recorded run, of one participant or of all.

    Raises MessageError for one that cannot be read.
    """
    decode = Decoder(CallRecord)
    if layout.CALLS_TOPIC not in recording:
        return []
    calls = [decode(entry.data) for entry in recording[layout.CALLS_TOPIC].entries()]
    return [call for call in calls if participant in {None, call.participant}]


def _nobody(_reply: CallReply) -> None:
    """Nobody waits for the answer to a call that is done again."""
