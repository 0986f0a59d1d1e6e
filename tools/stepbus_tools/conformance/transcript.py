"""Everything a participant sent on the bus, in the order it arrived, and what was wrong with it."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgpack import ExtType

from stepbus_orchestrator.recording import raw_map
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import Sample, SlotError, read_stamp
from stepbus_schemas import (
    HANDSHAKE_STEP,
    UNDECODABLE,
    Decoder,
    Fault,
    Hello,
    Log,
    MessageError,
    Outputs,
    Ready,
    StepbusError,
    Types,
)

_DECODERS: Mapping[str, Decoder[Any]] = {
    "out": Decoder(Outputs),
    "log": Decoder(Log),
    "ready": Decoder(Ready),
    "fault": Decoder(Fault),
}
_decode_hello = Decoder(Hello)
_decode = msgspec.msgpack.Decoder(ext_hook=lambda code, data: ExtType(code, bytes(data))).decode


class Failed(StepbusError, AssertionError):
    """A participant did not do what the protocol demands; the text says what was observed."""


class Skipped(StepbusError):
    """A check does not apply to this participant, or cannot be judged; the text says why."""


class Transcript:
    """All messages of a participant, and the clauses that it breaks with them.

    alive: whether its liveliness token exists. asked: number of its requests to join. hello: its
    newest `Hello`. outputs: the published ones by step, handshakes excepted; packed: their bytes in
    the order they came. logged: bytes of the logged ones, in their order. encodings: channel, such
    as `out` or `bulk/<port>` → encodings. problems: clause → how it was broken first. content: of
    its bulk ports, by step and port. bulk_handshakes: its bulk ports with a handshake.
    read_slot: returns what a port has in its slot, raises SlotError.
    """

    def __init__(self, spec: ParticipantSpec, token: str, step_ns: int, types: Types) -> None:
        self._spec = spec
        self._token = token
        self._step_ns = step_ns
        self._bulk = {port for port, output in spec.outputs.items() if output.bulk}
        self._decoders = {
            port: Decoder(types[output.type]) for port, output in spec.outputs.items()
        }
        self.alive = self.alive_before_hello = False
        self.asked = 0
        self.hello: Hello | None = None
        self.handshakes = 0
        self.outputs: dict[int, Outputs] = {}
        self.packed: list[bytes] = []
        self.logs: list[Log] = []
        self.logged: list[bytes] = []
        self.log_before_ready = False
        self.readies: list[Ready] = []
        self.faults: list[Fault] = []
        self.encodings: dict[str, set[str]] = {}
        self.problems: dict[str, str] = {}
        self.content: dict[tuple[int, str], bytes] = {}
        self.bulk_handshakes: set[str] = set()
        self.read_slot: Callable[[str, Outputs], bytes] = _no_slots

    # --- what is in it -----------------------------------------------------------------------

    @property
    def awaited(self) -> set[tuple[int, str]]:
        """Return the bulk content, as step and port, that is announced and has not arrived."""
        announced = {(step, port) for step, out in self.outputs.items() for port in out.bulk}
        return announced - self.content.keys()

    @property
    def newest(self) -> int:
        """Return the newest step published; −1 before the first."""
        return max(self.outputs, default=-1)

    def problem(self, *clauses: str) -> str:
        """Return how the first of some clauses that is broken was broken; empty: none is."""
        return next((self.problems[c] for c in clauses if c in self.problems), "")

    @property
    def step_problem(self) -> str:
        """Return what is wrong with the steps, names or tokens of the outputs; empty: nothing."""
        return self.problem("P7.1", "P3.5", "P3.1")

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

    # --- what comes --------------------------------------------------------------------------

    def add_hello(self, data: bytes) -> None:
        """Record one request to join."""
        self.asked += 1
        self.alive_before_hello |= self.alive
        self._check_codecs("its Hello", data)
        try:
            self.hello = _decode_hello(data)
        except MessageError as exc:
            self._break("P4.2", f"its request to join: {exc}")

    def add(self, channel: str, sample: Sample) -> None:
        """Record one message; channel: the first part of its key."""
        data = sample.payload
        self.encodings.setdefault(channel, set()).add(sample.encoding)
        where = f"{channel}/{self._spec.name}"
        self._check_codecs(f"a message on {where}", data)
        try:
            message = _DECODERS[channel](data)
        except MessageError as exc:
            self._break("P3.4", f"on {where} arrived {exc}")
            return
        name = getattr(message, "name", self._spec.name)
        if message.token != self._token:
            self._break("P3.5", f"a message on {where} has another token")
        elif name != self._spec.name:
            self._break("P3.1", f"a message on {where} is from {name!r}")
        else:
            self._add(message, data)

    def _add(self, message: Outputs | Log | Ready | Fault, data: bytes) -> None:
        match message:
            case Outputs(step=step) if step == HANDSHAKE_STEP:
                self.handshakes += 1
                if message.t_ns or message.ports or message.bulk:
                    self._break(
                        "P4.6", f"its handshake is not empty or has t_ns {message.t_ns}, not 0"
                    )
            case Outputs():
                self._read_slots(message)
                self._check_order(message)
                self._check_ports(message)
                self.outputs.setdefault(message.step, message)
                self.packed.append(data)
            case Log():
                self._add_log(message)
            case Ready():
                self.readies.append(message)
            case Fault():
                self.faults.append(message)

    def _read_slots(self, outputs: Outputs) -> None:
        for port in outputs.slots:
            try:
                self.content[outputs.step, port] = self.read_slot(port, outputs)
            except SlotError as exc:
                self._break("P17.3", f"step {outputs.step}: {port}: {exc}")

    def add_bulk(self, port: str, sample: Sample) -> None:
        """Record one bulk sample; its attachment has its step (P7.5)."""
        content = sample.payload
        self.encodings.setdefault(f"bulk/{port}", set()).add(sample.encoding)
        step = read_stamp(sample.attachment, self._token)
        if step is None:
            self._break("P7.5", f"bulk content on {port} has no attachment with the token")
        elif step == HANDSHAKE_STEP:
            self.bulk_handshakes.add(port)
            if content:
                self._break("P4.6", f"its handshake on bulk port {port} is not empty")
        elif (step, port) in self.content:
            self._break("P7.5", f"step {step}: {port} has bulk content twice")
        else:
            self.content[step, port] = content
            self._check_codecs(f"the content of {port} at step {step}", content)
            if step in self.outputs:
                self._check_content(self.outputs[step], port)

    # --- what is wrong with it ---------------------------------------------------------------

    def _break(self, clause: str, text: str) -> None:
        self.problems.setdefault(clause, text)

    def _check_codecs(self, what: str, data: bytes) -> None:
        if problem := disagreement(data):
            self._break("P3.3", f"{what}: {problem}")

    def _check_type(self, step: int, port: str, data: bytes | msgspec.Raw) -> None:
        try:
            self._decoders[port](data)
        except MessageError as exc:
            self._break("P7.2", f"step {step}: {port} is {exc}")

    def _check_order(self, outputs: Outputs) -> None:
        step, right_ns = outputs.step, outputs.step * self._step_ns
        wanted = self.newest + self._spec.every if self.outputs else 0
        if step in self.outputs:
            self._break("P7.1", f"step {step} was published twice")
        elif step != wanted:
            self._break("P7.1", f"step {step} was published instead of {wanted}")
        if outputs.t_ns != right_ns:
            self._break("P7.1", f"t_ns of step {step} is {outputs.t_ns}, not {right_ns}")

    def _check_ports(self, outputs: Outputs) -> None:
        where = f"step {outputs.step}"
        for port, raw in outputs.ports.items():
            if port not in self._decoders:
                self._break("P7.2", f"{where} has {port!r}, which is not a port of the scenario")
            elif port in self._bulk:
                self._break("P7.3", f"{where} has the bulk port {port!r} in `ports`")
            else:
                self._check_type(outputs.step, port, raw)
        for port in outputs.bulk:
            if port not in self._bulk:
                self._break(
                    "P7.3",
                    (f"{where} announces bulk content on {port!r}, which is not a bulk port"),
                )
            elif (outputs.step, port) in self.content:
                self._check_content(outputs, port)

    def _check_content(self, outputs: Outputs, port: str) -> None:
        content, size = self.content[outputs.step, port], outputs.bulk[port]
        if len(content) != size:
            text = f"{port} has {len(content)} bytes, but {size} were announced"
            self._break("P7.3", f"step {outputs.step}: {text}")
        self._check_type(outputs.step, port, content)

    def _add_log(self, log: Log) -> None:
        self.log_before_ready |= not self.readies
        self.logs.append(log)
        self.logged += [bytes(raw) for raw in log.outputs]
        known = {item.source for item in self._spec.inputs.values()}
        strange = set(log.waiting.sources) - known if log.waiting else set()
        if strange:
            self._break(
                "P9.3",
                (f"it reports that it is waiting for {sorted(strange)}, which are not its sources"),
            )


def _no_slots(_port: str, _outputs: Outputs) -> bytes:
    raise SlotError("it is in a slot, but no slots were agreed on")


def disagreement(data: bytes) -> str:
    """Return how msgpack and msgspec differ in what they make of a message; empty: they agree."""
    try:
        theirs = raw_map(data)
    except MessageError as exc:
        return f"msgpack: {exc}"
    try:
        ours = _decode(data)
    except UNDECODABLE as exc:
        return f"msgspec cannot decode it: {exc}"
    # As text: NaN equals NaN there, 1 is not 1.0, and the order of the fields counts.
    different = [name for name in theirs if repr(theirs[name]) != repr(ours.get(name))]
    return f"msgpack and msgspec decode {different[0]!r} differently" if different else ""
