"""Everything a participant sent on the bus, in the order it arrived."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_participant import read_stamp
from stepbus_schemas import (
    HANDSHAKE_STEP,
    SHIPPED,
    Decoder,
    Fault,
    Hello,
    Log,
    MessageError,
    Outputs,
    Ready,
    Types,
)
from stepbus_tools.conformance.feeds import disagreement

_DECODERS: Mapping[str, Decoder[Any]] = {
    "out": Decoder(Outputs),
    "log": Decoder(Log),
    "ready": Decoder(Ready),
    "fault": Decoder(Fault),
}
_decode_hello = Decoder(Hello)


@dataclass
class Transcript:
    """All messages of a participant.

    alive: whether its liveliness token exists. asked: number of its
    requests to join. hello: its newest `Hello`. outputs: the published ones by step, handshakes
    excepted; packed: their bytes in the order they came. logged: bytes of the logged ones, in
    their order. encodings: first part of the key → encodings. problems: clause → how it was broken.
    content: of its bulk ports, by step and port. bulk_handshakes: its bulk ports with a handshake.
    """

    alive: bool = False
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
    content: dict[tuple[int, str], bytes] = field(default_factory=dict)
    bulk_handshakes: set[str] = field(default_factory=set)

    @property
    def awaited(self) -> set[tuple[int, str]]:
        """Return the bulk content, as step and port, that is announced and has not arrived."""
        return {
            (step, port)
            for step, outputs in self.outputs.items()
            for port in outputs.bulk
            if (step, port) not in self.content
        }

    @property
    def newest(self) -> int:
        """Return the newest step published; −1 before the first."""
        return max(self.outputs, default=-1)

    @property
    def drops(self) -> Mapping[str, int]:
        """Return cause → number of messages it reports as dropped."""
        return self.logs[-1].drops if self.logs else {}

    @property
    def step_problem(self) -> str | None:
        """Return what is wrong with the steps, names or tokens of the outputs; None: nothing."""
        return next(
            (self.problems[c] for c in ("P7.1", "P3.5", "P3.1") if c in self.problems), None
        )

    def waits(self, step: int, sources: set[str]) -> bool:
        """Return whether it reported to wait for these sources at a step; none: for the trigger."""
        waiting = [log.waiting for log in self.logs if log.waiting is not None]
        return any(w.step == step and set(w.sources) == sources for w in waiting)

    def ports(self) -> dict[int, dict[str, bytes]]:
        """Return the published messages: step → port → bytes."""
        return {
            step: {
                **{port: bytes(raw) for port, raw in outputs.ports.items()},
                **{port: self.content.get((step, port), b"") for port in outputs.bulk},
            }
            for step, outputs in sorted(self.outputs.items())
        }


class Recorder:
    """Records what a participant sends, and which clauses it breaks."""

    def __init__(
        self, spec: ParticipantSpec, token: str, step_ns: int, types: Types = SHIPPED
    ) -> None:
        self.transcript = Transcript()
        self._spec = spec
        self._token = token
        self._step_ns = step_ns
        self._bulk = {port for port, output in spec.outputs.items() if output.bulk}
        self._decoders = {
            port: Decoder(types[output.type]) for port, output in spec.outputs.items()
        }

    def add(self, channel: str, data: bytes, encoding: str) -> None:
        """Record one message; channel: the first part of its key."""
        self.transcript.encodings.setdefault(channel, set()).add(encoding)
        where = f"{channel}/{self._spec.name}"
        self._check_codecs(f"a message on {where}", data)
        try:
            message = _DECODERS[channel](data)
        except MessageError as exc:
            self._add_problem("P3.4", f"on {where} came {exc}")
            return
        name = getattr(message, "name", self._spec.name)
        if message.token != self._token:
            self._add_problem("P3.5", f"a message on {where} has another token")
        if name != self._spec.name:
            self._add_problem("P3.1", f"a message on {where} is from {name!r}")
        if message.token == self._token and name == self._spec.name:
            self._add(message, data)

    def _add(self, message: Outputs | Log | Ready | Fault, data: bytes) -> None:
        match message:
            case Outputs(step=step) if step == HANDSHAKE_STEP:
                self._add_handshake(message)
            case Outputs():
                self._check_order(message)
                self._check_ports(message)
                self.transcript.outputs.setdefault(message.step, message)
                self.transcript.packed.append(data)
            case Log():
                self._add_log(message)
            case Ready():
                self.transcript.readies.append(message)
            case Fault():
                self.transcript.faults.append(message)

    def add_bulk(self, port: str, stamped: bytes, content: bytes, encoding: str) -> None:
        """Record one bulk sample; stamped: its attachment (P7.5)."""
        transcript = self.transcript
        transcript.encodings.setdefault(f"bulk/{port}", set()).add(encoding)
        step = read_stamp(stamped, self._token)
        if step is None:
            self._add_problem("P7.5", f"bulk content on {port} has no attachment with the token")
        elif step == HANDSHAKE_STEP:
            transcript.bulk_handshakes.add(port)
            if content:
                self._add_problem("P4.6", f"its handshake on bulk port {port} is not empty")
        elif (step, port) in transcript.content:
            self._add_problem("P7.5", f"step {step}: {port} has bulk content twice")
        else:
            transcript.content[step, port] = content
            self._check_codecs(f"the content of {port} at step {step}", content)
            if step in transcript.outputs:
                self._check_content(transcript.outputs[step], port)

    def _check_content(self, outputs: Outputs, port: str) -> None:
        content, size = self.transcript.content.get((outputs.step, port)), outputs.bulk[port]
        if content is None:
            return
        if len(content) != size:
            text = f"step {outputs.step}: {port} has {len(content)} bytes, announced were {size}"
            self._add_problem("P7.3", text)
        try:
            self._decoders[port](content)
        except MessageError as exc:
            self._add_problem("P7.2", f"step {outputs.step}: {port} is {exc}")

    def add_hello(self, data: bytes) -> None:
        """Record one request to join."""
        self.transcript.asked += 1
        self.transcript.alive_before_hello |= self.transcript.alive
        self._check_codecs("its Hello", data)
        try:
            self.transcript.hello = _decode_hello(data)
        except MessageError as exc:
            self._add_problem("P4.2", f"its request to join is {exc}")

    def _check_codecs(self, what: str, data: bytes) -> None:
        if problem := disagreement(data):
            self._add_problem("P3.3", f"{what}: {problem}")

    def _add_problem(self, clause: str, text: str) -> None:
        self.transcript.problems.setdefault(clause, text)

    def _add_handshake(self, outputs: Outputs) -> None:
        self.transcript.handshakes += 1
        if outputs.t_ns or outputs.ports or outputs.bulk:
            self._add_problem(
                "P4.6", f"its handshake is not empty, or has t_ns {outputs.t_ns}, not 0"
            )

    def _check_order(self, outputs: Outputs) -> None:
        transcript, every, step = self.transcript, self._spec.every, outputs.step
        wanted = transcript.newest + every if transcript.outputs else 0
        if step in transcript.outputs:
            self._add_problem("P7.1", f"step {step} was published twice")
        elif step != wanted:
            self._add_problem("P7.1", f"step {step} was published where {wanted} is due")
        if outputs.t_ns != step * self._step_ns:
            right = step * self._step_ns
            self._add_problem("P7.1", f"t_ns of step {step} is {outputs.t_ns}, not {right}")

    def _check_ports(self, outputs: Outputs) -> None:
        where = f"step {outputs.step}"
        for port, raw in outputs.ports.items():
            decode = self._decoders.get(port)
            if decode is None:
                self._add_problem("P7.2", f"{where} has {port!r}, which is no port of the scenario")
                continue
            try:
                decode(raw)
            except MessageError as exc:
                self._add_problem("P7.2", f"{where}: {port} is {exc}")
        for port in outputs.bulk:
            if port not in self._bulk:
                text = f"{where} announces bulk content on {port!r}, which is no bulk port"
                self._add_problem("P7.3", text)
            else:
                self._check_content(outputs, port)
        for port in self._bulk & outputs.ports.keys():
            self._add_problem("P7.3", f"{where} has the bulk port {port!r} in `ports`")

    def _add_log(self, log: Log) -> None:
        self.transcript.log_before_ready |= not self.transcript.readies
        self.transcript.logs.append(log)
        self.transcript.logged += [bytes(raw) for raw in log.outputs]
        known = {item.source for item in self._spec.inputs.values()}
        strange = set(log.waiting.sources) - known if log.waiting else set()
        if strange:
            self._add_problem(
                "P9.3", f"it reports to wait for {sorted(strange)}, which are no sources of it"
            )
