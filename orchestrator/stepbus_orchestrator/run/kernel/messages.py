"""What participants send the orchestrator: checked, and taken into the state of the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from stepbus_orchestrator.errors import ParticipantFault, StartFailed
from stepbus_orchestrator.processes.endpoints import ORCHESTRATOR
from stepbus_orchestrator.recording import Sink, TimingRecorder
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario
from stepbus_participant import Bus, read_stamp
from stepbus_schemas import (
    Decoder,
    Fault,
    Hello,
    Log,
    MessageError,
    Outputs,
    Ready,
    Refusal,
    encode,
    encoding_of,
)

from .admission import max_message_bytes, receive, welcome_of
from .barrier import Barrier
from .deadlines import at, skipped
from .participants import Member, Phase, Roster

_decode_hello = Decoder(Hello)
_decode_ready = Decoder(Ready)
_decode_log = Decoder(Log)
_decode_outputs = Decoder(Outputs)
_decode_fault = Decoder(Fault)


@dataclass
class RunState:
    """How far a run is.

    phase: `starting`, `stepping` or `stopping`. unauthenticated: messages that were not taken.
    end: the step before which the run ends, and why, once somebody has asked for it. compute:
    participant → total computing time [ns] and number of steps. started_at: when the first trigger
    was sent, by the monotonic clock [s]. replaced: who has failed and is stood in for.
    """

    scenario: Scenario
    barrier: Barrier
    roster: Roster = field(default_factory=dict)
    phase: str = "starting"
    unauthenticated: int = 0
    end: tuple[int, str] | None = None
    compute: dict[str, tuple[int, int]] = field(default_factory=dict)
    started_at: float = 0.0
    replaced: str | None = None

    def at(self, step: int) -> str:
        """Return `step 1042 (t = 5.210 s)`."""
        return at(step, self.scenario.step_ns)

    def check_size(self, what: str, data: bytes) -> None:
        """Raise StartFailed for what the low-latency transport would silently lose."""
        limit = max_message_bytes(self.scenario)
        if len(data) > limit:
            raise StartFailed(
                f"before the first step: {what} take {len(data)} bytes, over the {limit} that the "
                "low-latency transport carries; set bus.low_latency: false"
            )


class Intake:
    """Takes in what participants send; strangers and broken messages are counted, no more.

    died: is called when a process of ours is seen to have ended. Its methods run on the
    conductor's thread and raise RunFailure when a message ends the run.
    """

    def __init__(
        self,
        *,
        state: RunState,
        bus: Bus,
        token: str,
        recorder: Sink,
        timing: TimingRecorder,
        died: Callable[[], None],
    ) -> None:
        self._state = state
        self._bus = bus
        self._token = token
        self._recorder = recorder
        self._timing = timing
        self._died = died
        self._step_ns = state.scenario.step_ns
        specs = state.scenario.participants
        self._ports = {spec.name: _Ports(spec) for spec in specs}
        self._welcomes = {spec.name: welcome_of(state.scenario, spec, token) for spec in specs}

    def take_alive(self, item: tuple[str, bool]) -> None:
        """Take in that somebody has come to the bus, or left it."""
        key, alive = item
        name = key.removeprefix("alive/")
        state = self._state
        member = state.roster.get(name)
        if member is None:
            state.unauthenticated += alive and name != ORCHESTRATOR
            return
        if alive and member.advance(Phase.ALIVE):
            self._timing.event("alive", member.name)
        if (
            not alive
            and name != state.replaced
            and state.phase != "stopping"
            and member.child.wait(_GONE_S)
        ):
            self._died()

    def take_join(self, request: Any) -> None:
        """Answer a `Hello`."""
        try:
            hello = _decode_hello(request.payload)
        except MessageError as exc:
            self._state.unauthenticated += 1
            request.reply(encode(Refusal(reason=str(exc))), encoding_of("Refusal/1"))
            return
        # Nobody of ours can ask before its process is started.
        roster = self._state.roster
        answer = receive(hello, {name: self._welcomes[name] for name in roster}, self._token)
        if isinstance(answer, Refusal):
            request.reply(encode(answer), encoding_of("Refusal/1"))
            self._refused(hello, answer)
            return
        welcome = encode(answer)
        self._state.check_size(f"the params of {hello.name}", welcome)
        request.reply(welcome, encoding_of("Welcome/1"))
        member = roster[hello.name]
        member.language = hello.language
        if member.advance(Phase.JOINED):
            self._timing.event("join", member.name, f"{hello.language} {hello.sdk}".strip())

    def _refused(self, hello: Hello, refusal: Refusal) -> None:
        """End the run when one of ours cannot join; a stranger is only counted."""
        roster = self._state.roster
        if hello.token != self._token or hello.name not in roster:
            self._state.unauthenticated += 1
            return
        raise StartFailed(
            f"before the first step: {roster[hello.name].who()} was refused: {refusal.reason}",
            participant=hello.name,
        )

    def _member(self, token: str, name: str, key_name: str) -> Member | None:
        """Return whom a message is from; None, and counted, when it is a stranger's."""
        member = self._state.roster.get(name)
        if token != self._token or member is None or name != key_name:
            self._state.unauthenticated += 1
            return None
        # What comes late from one that is stood in for is published already.
        return None if name == self._state.replaced else member

    def _name_in_key(self, sample: Any) -> str:
        return self._bus.key(sample).rpartition("/")[2]

    def take_ready(self, sample: Any) -> None:
        """Take in that somebody is ready, and what it says of its outputs."""
        try:
            ready = _decode_ready(self._bus.payload(sample))
        except MessageError:
            self._state.unauthenticated += 1
            return
        member = self._member(ready.token, ready.name, self._name_in_key(sample))
        if member is not None and member.advance(Phase.READY):
            member.ready = ready
            self._timing.event("ready", member.name)

    def take_log(self, key_name: str, sample: Any) -> None:
        """Take in a batch of outputs, from the key of `key_name`."""
        try:
            log = _decode_log(self._bus.payload(sample))
        except MessageError:
            self._state.unauthenticated += 1
            return
        member = self._member(log.token, log.name, key_name)
        if member is None:
            return
        self._check_waiting(member, log)
        member.waiting, member.drops = log.waiting, log.drops
        for raw in log.outputs:
            self._take_outputs(member, raw)
        if log.timing:
            self._note_timing(log)

    def _check_waiting(self, member: Member, log: Log) -> None:
        if log.waiting is None:
            return
        sources = [item.source for item in member.spec.inputs.values()]
        if any(name not in sources for name in log.waiting.sources):
            raise self._broken(member, "says it waits for somebody who is no source of it")

    def take_outputs(self, name: str, data: bytes) -> None:
        """Take in outputs that the orchestrator publishes in a participant's stead."""
        self._take_outputs(self._state.roster[name], data)

    def _take_outputs(self, member: Member, raw: Any) -> None:
        state = self._state
        if not state.started_at:
            raise self._broken(member, "logged outputs before the start")
        try:
            outputs = _decode_outputs(raw)
        except MessageError as exc:
            raise self._broken(member, f"logged something that is {exc}") from exc
        if outputs.token != self._token or outputs.t_ns != outputs.step * self._step_ns:
            raise self._broken(member, f"sent a wrong token or time (t_ns = {outputs.t_ns})")
        wrong = self._ports[member.name].wrong(outputs)
        if wrong:
            raise self._broken(member, wrong)
        if not state.barrier.report(member.name, outputs.step):
            raise skipped(member, outputs.step, state.barrier, self._step_ns)
        self._recorder.offer(member.name, outputs)
        if outputs.end is not None:
            end = (outputs.step + 1, f"{member.name}: {outputs.end}")
            state.end = end if state.end is None else min(state.end, end)

    def _broken(self, member: Member, what: str) -> ParticipantFault:
        step = self._state.barrier.next_step(member.name)
        return ParticipantFault(
            f"{self._state.at(step)}: {member.who()} {what}; see docs/protocol.md",
            participant=member.name,
            step=step,
        )

    def _note_timing(self, log: Log) -> None:
        self._timing.steps(log.name, log.timing)
        total, count = self._state.compute.get(log.name, (0, 0))
        for _, _, computed in log.timing:
            total += computed
        self._state.compute[log.name] = (total, count + len(log.timing))

    def take_bulk(self, sample: Any) -> None:
        """Take in bulk content."""
        step = read_stamp(self._bus.attachment(sample), self._token)
        _, name, port = self._bus.key(sample).split("/")
        member = self._state.roster.get(name)
        output = member.spec.outputs.get(port) if member is not None else None
        if step is None or output is None or not output.bulk:
            self._state.unauthenticated += 1
        elif step >= 0:
            self._recorder.offer_bulk(name, port, step, self._bus.payload(sample))

    def take_fault(self, sample: Any) -> None:
        """End the run with what a participant says has gone wrong."""
        try:
            fault = _decode_fault(self._bus.payload(sample))
        except MessageError:
            self._state.unauthenticated += 1
            return
        member = self._member(fault.token, fault.name, self._name_in_key(sample))
        if member is None:
            return
        blamed = self._state.roster.get(fault.blames or fault.name, member)
        seen = "" if blamed is member else f" (seen by {member.who()})"
        kind = StartFailed if member.phase < Phase.READY else ParticipantFault
        failure = kind(
            f"{self._state.at(fault.step)}: {blamed.who()}: {fault.message}{seen}; "
            f"its log: {blamed.child.log}",
            participant=blamed.name,
            step=fault.step,
        )
        if isinstance(failure, ParticipantFault) and blamed is not member:
            failure.witness = member.name
        raise failure


# Its process may take this long to end after it has left the bus [s].
_GONE_S = 0.05


class _Ports:
    """The ports of one participant."""

    def __init__(self, spec: ParticipantSpec) -> None:
        self._plain = {port for port, output in spec.outputs.items() if not output.bulk}
        self._bulk = set(spec.outputs) - self._plain

    def wrong(self, outputs: Outputs) -> str | None:
        """Return what is wrong with what was published, if anything is."""
        if outputs.ports.keys() <= self._plain and outputs.bulk.keys() <= self._bulk:
            return None
        known = self._plain | self._bulk
        unknown = [port for port in (*outputs.ports, *outputs.bulk) if port not in known]
        if unknown:
            return f"published on {unknown[0]!r}, not a port of the scenario"
        return "published a port as bulk that is none, or the reverse"
