"""What participants send the orchestrator: checked, and taken into the state of the run."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

from stepbus_orchestrator.errors import (
    BusFailed,
    ParticipantFault,
    RunFailure,
    StartFailed,
    indented,
)
from stepbus_orchestrator.recording import Sink, TimingRecorder
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import read_stamp
from stepbus_schemas import (
    UNDECODABLE,
    Decoder,
    Envelope,
    Fault,
    Hello,
    Log,
    MessageError,
    Outputs,
    Ready,
    Refusal,
    Waiting,
    Welcome,
    encode,
    reached,
)

from .admission import receive, welcome_of
from .participants import ParticipantState, Phase

_ORCHESTRATOR = "orchestrator"
"""Whose own liveliness token that is (P3.1)."""

_decode_hello = Decoder(Hello)
_decode_ready = Decoder(Ready)
_decode_raw_log = Decoder(Log)
_decode_outputs = Decoder(Outputs)
_decode_fault = Decoder(Fault)


TakeSlots = Callable[[str, Outputs, Sink], str | None]
"""Hands on what is in slots; returns what is wrong with it."""


class _WholeLog(Envelope, frozen=True):
    """A `Log`, decoded together with its entries."""

    name: str
    token: str
    outputs: list[Outputs] = msgspec.field(default_factory=list)
    timing: list[tuple[int, int, int]] = msgspec.field(default_factory=list)
    waiting: Waiting | None = None
    drops: dict[str, int] = msgspec.field(default_factory=dict)


_decode_whole_log = msgspec.msgpack.Decoder(_WholeLog).decode


def _decode_log(data: Any) -> Log | _WholeLog:
    """Return a log; where one of its entries is malformed, with their bytes: those before count.

    data: of a participant in this process, the log itself, with `Outputs` that are checked.
    """
    if isinstance(data, Log):
        return data
    try:
        return _decode_whole_log(data)
    except UNDECODABLE:
        return _decode_raw_log(data)


class MessageHandler:
    """Takes what participants send; unauthenticated and malformed messages are counted (P8.6).

    Methods take the name in the message's key, and raise RunFailure for a message that ends the
    run.
    """

    def __init__(
        self,
        state: RunState,
        token: str,
        recorder: Sink,
        timing: TimingRecorder,
        *,
        take_slots: TakeSlots = lambda _name, _outputs, _sink: "has no slots",
    ) -> None:
        self._state = state
        self._token = token
        self._recorder = recorder
        self._timing = timing
        self._step_ns = state.scenario.step_ns
        specs = state.scenario.participants
        self._wrong_ports = {spec.name: _wrong_ports(spec) for spec in specs}
        self.logs: Mapping[str, deque[bytes]] = {
            spec.name: deque(maxlen=_logs_kept(state.scenario, spec)) for spec in specs
        }
        """The newest logs of each participant that hold outputs."""
        self._welcomes = {spec.name: welcome_of(state.scenario, spec, token) for spec in specs}
        self._take_slots = take_slots

    def take_alive(self, name: str, is_alive: bool) -> None:
        """Record that a participant has come to the bus, or left it."""
        participant = self._state.participants.get(name)
        if participant is None:
            self._state.unauthenticated += is_alive and name != _ORCHESTRATOR
        elif not is_alive:
            participant.has_left = True
            if participant.external is not None:
                participant.external.left()
            # Its process may have ended; that is seen at the next check, which need not wait.
            self._state.is_check_due = True
        elif participant.advance(Phase.ALIVE):
            self._timing.event("alive", name)

    def take_join(self, data: bytes, reply: Callable[[Welcome | Refusal], None]) -> None:
        """Answer a `Hello`; an unauthenticated one is refused and counted (P4.2, P4.3)."""
        try:
            hello = _decode_hello(data)
        except MessageError as exc:
            self._state.unauthenticated += 1
            reply(Refusal(reason=str(exc)))
            return
        # None of ours can ask before its process has been started.
        participants = self._state.participants
        answer = receive(hello, {name: self._welcomes[name] for name in participants}, self._token)
        participant = participants.get(hello.name) if hello.token == self._token else None
        if isinstance(answer, Refusal):
            reply(answer)
            if participant is None:
                self._state.unauthenticated += 1
                return
            reached("a participant is refused")
            raise self._state.failure(StartFailed, participant, -1, f"was refused: {answer.reason}")
        self._state.check_size(f"the params of {hello.name}", encode(answer))
        reply(answer)
        if participant is not None:
            self._admit(participant, hello)

    def _admit(self, participant: ParticipantState, hello: Hello) -> None:
        participant.language = hello.language
        participant.takes_batches = hello.batches
        if participant.external is not None:
            participant.external.joined(hello.pid)
        if participant.advance(Phase.JOINED):
            self._timing.event("join", participant.name, f"{hello.language} {hello.sdk}".strip())

    def sender(
        self, decode: Callable[[bytes], Any], data: bytes, key_name: str
    ) -> tuple[ParticipantState, Any] | None:
        """Return the sender of an envelope, and what it holds.

        None for one that changes nothing: unauthenticated, which is counted (P3.5), or of a
        participant that is replaced.
        """
        try:
            message = decode(data)
        except MessageError:
            self._state.unauthenticated += 1
            return None
        name = message.name
        participant = self._state.participants.get(name)
        if message.token != self._token or participant is None or name != key_name:
            self._state.unauthenticated += 1
            return None
        # What comes late from a participant that is replaced has been published already.
        return None if name == self._state.replaced else (participant, message)

    def take_ready(self, key_name: str, data: bytes) -> None:
        """Record that a participant is ready, and its descriptions (P4.7)."""
        if sent := self.sender(_decode_ready, data, key_name):
            participant, ready = sent
            if participant.advance(Phase.READY):
                participant.ready = ready
                self._timing.event("ready", participant.name)

    def take_log(self, key_name: str, data: Any) -> None:
        """Take a batch of outputs (P9)."""
        sent = self.sender(_decode_log, data, key_name)
        if sent is None:
            return
        participant, log = sent
        waiting = log.waiting
        if waiting is not None:
            sources = [item.source for item in participant.spec.inputs.values()]
            if any(name not in sources for name in waiting.sources):
                what = "reports that it is waiting for a participant that is not one of its sources"
                raise self._broken(participant, what)
        participant.waiting = waiting
        participant.drops = log.drops
        participant.missed_trigger = (
            waiting is not None and not waiting.sources and waiting.step < self._state.released
        )
        if log is data:
            self._take_checked(participant, log.outputs)
        elif log.outputs:
            self.logs[participant.name].append(data)
        if isinstance(log, _WholeLog):
            self._take_batch(participant, log.outputs)
        elif log is not data:
            self._take_batch(participant, self._one_by_one(participant, log.outputs))
        if log.timing:
            self._add_timing(log)

    def _one_by_one(
        self, participant: ParticipantState, entries: Iterable[Any]
    ) -> Iterator[Outputs]:
        for raw in entries:
            try:
                yield _decode_outputs(raw)
            except MessageError as exc:
                raise self._broken(participant, f"logged something that is {exc}") from exc

    def take_outputs(self, name: str, data: bytes) -> None:
        """Take outputs that the orchestrator publishes for a participant that has failed."""
        participant = self._state.participants[name]
        self._take_batch(participant, self._one_by_one(participant, [data]))

    def _take_batch(self, participant: ParticipantState, batch: Iterable[Outputs]) -> None:
        """Take outputs of one participant, in the order of their steps."""
        state, name = self._state, participant.name
        wrong, report, offer = self._wrong_ports[name], state.barrier.report, self._recorder.offer
        for outputs in batch:
            if not state.started_at:
                raise self._broken(participant, "sent outputs before the run started")
            step, t_ns = outputs.step, outputs.t_ns
            if outputs.token != self._token or t_ns != step * self._step_ns:
                raise self._broken(participant, f"sent a wrong token or time (t_ns = {t_ns})")
            if problem := wrong(outputs):
                raise self._broken(participant, problem)
            # Once its outputs are reported, a participant may use their slots again.
            if outputs.slots and (problem := self._take_slots(name, outputs, self._recorder)):
                raise self._broken(participant, problem)
            if not report(name, step):
                reached("a log is out of order")
                raise state.failure(
                    ParticipantFault,
                    participant,
                    state.barrier.next_step(name),
                    f"reported step {step} instead; it must publish at every step it fires at, in "
                    "order",
                )
            state.newest[name] = outputs.ports
            offer(name, outputs)
            if outputs.end is not None and step >= state.ends_from.get(name, 0):
                state.ask_end(step + 1, f"{name}: {outputs.end}")

    def _take_checked(self, participant: ParticipantState, batch: Sequence[Any]) -> None:
        """Take outputs that were checked when they were published."""
        state, name = self._state, participant.name
        if batch:
            state.barrier.advance(name, batch[-1].step, len(batch))
            state.newest[name] = batch[-1].ports
            self._recorder.offer_all(name, batch)
        for outputs in batch:
            if outputs.end is not None and outputs.step >= state.ends_from.get(name, 0):
                state.ask_end(outputs.step + 1, f"{name}: {outputs.end}")

    def _broken(self, participant: ParticipantState, what: str) -> ParticipantFault:
        reached("a participant breaks the protocol in its log")
        step = self._state.barrier.next_step(participant.name)
        what = f"{what}; see docs/protocol.md"
        return self._state.failure(ParticipantFault, participant, step, what)

    def _add_timing(self, log: Log | _WholeLog) -> None:
        self._timing.steps(log.name, log.timing)
        total, count = self._state.compute.get(log.name, (0, 0))
        _, waited, computed = map(sum, zip(*log.timing, strict=True))
        self._state.waited[log.name] = self._state.waited.get(log.name, 0) + waited
        self._state.compute[log.name] = (total + computed, count + len(log.timing))

    def take_bulk(self, name: str, port: str, stamp: bytes, data: bytes) -> None:
        """Take bulk content; stamp: step and token, from its attachment (P7.5, P8.3)."""
        step = read_stamp(stamp, self._token)
        participant = self._state.participants.get(name)
        output = participant.spec.outputs.get(port) if participant is not None else None
        if step is None or output is None or not output.bulk:
            self._state.unauthenticated += 1
        elif step >= 0:
            self._recorder.offer_bulk(name, port, step, data)

    def take_fault(self, key_name: str, data: bytes) -> None:
        """End the run with the fault that a participant reports (P10)."""
        if sent := self.sender(_decode_fault, data, key_name):
            participant, fault = sent
            blamed = self._state.participants.get(fault.blames or fault.name, participant)
            seen = "" if blamed is participant else f" (seen by {participant.who()})"
            failed: type[RunFailure] = ParticipantFault
            if participant.phase < Phase.READY:
                failed = StartFailed
            elif fault.type == "bus":
                failed = BusFailed
            when, prints = self._state.at(fault.step), blamed.where_it_prints()
            failure = failed(
                f"{when}: {blamed.who()}: {indented(fault.message)}{seen}; {prints}",
                participant=blamed.name,
                step=fault.step,
            )
            if isinstance(failure, ParticipantFault) and blamed is not participant:
                reached("a participant reports a fault of another one")
                failure.witness = participant.name
            reached("a participant reports a fault")
            raise failure


def _logs_kept(scenario: Scenario, spec: ParticipantSpec) -> int:
    """Return how many logs of a participant hold all that may be asked for again."""
    readers = [
        (item.delay, one.every)
        for one in scenario.participants
        for item in one.inputs.values()
        if item.source == spec.name
    ]
    steps = scenario.window + max((delay + every for delay, every in readers), default=0)
    return steps // spec.every + 2


def _wrong_ports(spec: ParticipantSpec) -> Callable[[Outputs], str | None]:
    """Return a function that says what is wrong with the ports of outputs, or None (P7.2, P7.3)."""
    plain = {port for port, output in spec.outputs.items() if not output.bulk}
    bulk = set(spec.outputs) - plain

    def wrong(outputs: Outputs) -> str | None:
        if outputs.ports.keys() <= plain and outputs.bulk.keys() <= bulk:
            return None
        unknown = [port for port in (*outputs.ports, *outputs.bulk) if port not in spec.outputs]
        if unknown:
            return f"published on {unknown[0]!r}, not a port of the scenario"
        return "published a plain port as bulk, or a bulk port as plain"

    return wrong
