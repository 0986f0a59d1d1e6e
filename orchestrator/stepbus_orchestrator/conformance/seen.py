"""What a participant was seen to say on the bus, in the order it came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_schemas import (
    HANDSHAKE_STEP,
    Decoder,
    Fault,
    Hello,
    Log,
    MessageError,
    Outputs,
    Ready,
    message_class,
)

_decode_outputs = Decoder(Outputs)
_decode_log = Decoder(Log)
_decode_ready = Decoder(Ready)
_decode_fault = Decoder(Fault)
_decode_hello = Decoder(Hello)


@dataclass
class Seen:
    """All that a participant has said.

    alive, was_alive: whether its liveliness token is there, and ever was. asked: how often it
    asked to join. hello: its newest `Hello`. outputs: the published ones by step, handshakes
    excepted; packed: their bytes in the order they came. logged: bytes of the logged ones, in
    their order. encodings: of what came, by kind of key. problems: clause → what broke it.
    """

    alive: bool = False
    was_alive: bool = False
    alive_before_hello: bool = False
    asked: int = 0
    hello: Hello | None = None
    handshakes: int = 0
    outputs: dict[int, Outputs] = field(default_factory=dict)
    packed: list[bytes] = field(default_factory=list)
    logs: list[Log] = field(default_factory=list)
    logged: list[bytes] = field(default_factory=list)
    log_before_ready: bool = False
    readies: list[Ready] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    encodings: dict[str, set[str]] = field(default_factory=dict)
    problems: dict[str, str] = field(default_factory=dict)

    @property
    def newest(self) -> int:
        """Return the newest step published; −1 before the first."""
        return max(self.outputs, default=-1)

    @property
    def drops(self) -> Mapping[str, int]:
        """Return what it says it has dropped."""
        return self.logs[-1].drops if self.logs else {}

    def waits(self, step: int, sources: set[str]) -> bool:
        """Return whether it has said that it waits for these at a step; none: for the trigger."""
        waiting = [log.waiting for log in self.logs if log.waiting is not None]
        return any(w.step == step and set(w.sources) == sources for w in waiting)

    def ports(self) -> dict[int, dict[str, bytes]]:
        """Return the published messages: step → port → bytes."""
        return {
            step: {port: bytes(raw) for port, raw in outputs.ports.items()}
            for step, outputs in sorted(self.outputs.items())
        }


class Ear:
    """Takes what a participant sends into `seen`, and notes what the protocol forbids."""

    def __init__(self, spec: ParticipantSpec, token: str, step_ns: int) -> None:
        self.seen = Seen()
        self._spec = spec
        self._token = token
        self._step_ns = step_ns
        self._decoders = {
            port: Decoder(message_class(output.type)) for port, output in spec.outputs.items()
        }

    def take(self, kind: str, data: bytes, encoding: str) -> None:
        """Take one message; kind: the first part of its key."""
        self.seen.encodings.setdefault(kind, set()).add(encoding)
        try:
            if kind == "out":
                self._take_outputs(data)
            elif kind == "log":
                self._take_log(data)
            elif kind == "ready":
                self._take_ready(data)
            else:
                self._take_fault(data)
        except MessageError as exc:
            self._note("P3.4", f"on {kind}/{self._spec.name} came what is {exc}")

    def take_hello(self, data: bytes) -> None:
        """Take one request to join."""
        self.seen.asked += 1
        self.seen.alive_before_hello |= self.seen.alive
        try:
            self.seen.hello = _decode_hello(data)
        except MessageError as exc:
            self._note("P4.2", f"its request to join is {exc}")

    def _note(self, clause: str, text: str) -> None:
        self.seen.problems.setdefault(clause, text)

    def _is_ours(self, kind: str, token: str, name: str) -> bool:
        if token != self._token:
            self._note("P3.5", f"a message on {kind}/{self._spec.name} has another token")
        if name != self._spec.name:
            self._note("P3.1", f"a message on {kind}/{self._spec.name} is from {name!r}")
        return token == self._token and name == self._spec.name

    def _take_outputs(self, data: bytes) -> None:
        outputs = _decode_outputs(data)
        if not self._is_ours("out", outputs.token, self._spec.name):
            return
        if outputs.step == HANDSHAKE_STEP:
            self._take_handshake(outputs)
            return
        self._check_order(outputs)
        self._check_ports(outputs)
        self.seen.outputs.setdefault(outputs.step, outputs)
        self.seen.packed.append(data)

    def _take_handshake(self, outputs: Outputs) -> None:
        self.seen.handshakes += 1
        if outputs.t_ns or outputs.ports or outputs.bulk:
            self._note("P4.6", f"its handshake is not empty, or has t_ns {outputs.t_ns}, not 0")

    def _check_order(self, outputs: Outputs) -> None:
        seen, every, step = self.seen, self._spec.every, outputs.step
        wanted = seen.newest + every if seen.outputs else 0
        if step in seen.outputs:
            self._note("P7.1", f"step {step} was published twice")
        elif step != wanted:
            self._note("P7.1", f"step {step} was published where {wanted} is due")
        if outputs.t_ns != step * self._step_ns:
            right = step * self._step_ns
            self._note("P7.1", f"t_ns of step {step} is {outputs.t_ns}, not {right}")

    def _check_ports(self, outputs: Outputs) -> None:
        where = f"step {outputs.step}"
        for port, raw in outputs.ports.items():
            decode = self._decoders.get(port)
            if decode is None:
                self._note("P7.2", f"{where} has {port!r}, which is no port of the scenario")
                continue
            try:
                decode(raw)
            except MessageError as exc:
                self._note("P7.2", f"{where}: {port} is {exc}")
        if outputs.bulk:
            self._note("P7.3", f"{where} announces bulk content, and there is no bulk port")

    def _take_log(self, data: bytes) -> None:
        log = _decode_log(data)
        if self._is_ours("log", log.token, log.name):
            self.seen.log_before_ready |= not self.seen.readies
            self.seen.logs.append(log)
            self.seen.logged += [bytes(raw) for raw in log.outputs]
            self._check_sources(log)

    def _check_sources(self, log: Log) -> None:
        known = {item.source for item in self._spec.inputs.values()}
        strange = set(log.waiting.sources) - known if log.waiting else set()
        if strange:
            self._note("P9.3", f"it says it waits for {sorted(strange)}, no sources of it")

    def _take_ready(self, data: bytes) -> None:
        ready = _decode_ready(data)
        if self._is_ours("ready", ready.token, ready.name):
            self.seen.readies.append(ready)

    def _take_fault(self, data: bytes) -> None:
        fault = _decode_fault(data)
        if self._is_ours("fault", fault.token, fault.name):
            self.seen.faults.append(fault)
