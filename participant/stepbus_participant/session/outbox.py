"""What a participant publishes: one `Outputs` per step to its consumers, and logs in batches."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from stepbus_participant.bus import Bus
from stepbus_participant.bus.slots import SlotWriter
from stepbus_participant.bus.ticket import MessageFault
from stepbus_schemas import (
    HANDSHAKE_STEP,
    SHIPPED,
    UNDECODABLE,
    Batch,
    Decoder,
    Description,
    Log,
    Message,
    OutputConfig,
    Outputs,
    StepbusError,
    Types,
    Waiting,
    Welcome,
    encode,
    encoding_of,
    explained,
    fields_of,
    parts_of,
    type_name,
)

_PER_NAME = "n"
"""Size of a vector with one value for each name."""


def stamp(step: int, token: str) -> bytes:
    """Return the attachment: the step as int64 little-endian, then the token."""
    return step.to_bytes(8, "little", signed=True) + token.encode()


def read_stamp(attachment: bytes, token: str) -> int | None:
    """Return the step of a bulk sample, or None where it is not of this run."""
    if attachment[8:] != token.encode():
        return None
    return int.from_bytes(attachment[:8], "little", signed=True)


BATCH_BYTES = 30_000
"""Most bytes of a batch (P9.2.3): the low-latency transport silently loses what exceeds 64 KiB."""

_ENVELOPE_BYTES, _PORT_BYTES = 300, 20
"""More than `Outputs` take beside the names and the contents of their ports, and for each port."""

_HANDED_OVER = 16
"""Steps of a batch that need not be encoded; the more, the longer lasts the step that records."""

_UNENCODABLE = (KeyError, TypeError, OverflowError, ValueError, msgspec.MsgspecError)

BATCH_AGE_NS = 50_000_000
"""Longest time a batch takes to fill (P9.2.2), so that the orchestrator sees slow steps [ns]."""

HOLD_NS = 2_000_000
"""Longest time for which outputs are held that may go out with the next ones (P7.6) [ns]."""


class OutputError(StepbusError, ValueError):
    """A participant returned something that its scenario does not let it publish."""


def names_of(
    outputs: Mapping[str, Description], inputs: Mapping[str, Description]
) -> dict[str, list[str]]:
    """Return the names of each output; those of the input that it is `like`."""
    return {port: inputs.get(row.like or "", row).names for port, row in outputs.items()}


class _TypeCheck:
    """Checks the messages of one port as its readers decode them.

    names: of the port's description.
    """

    def __init__(self, name: str, types: Types) -> None:
        self._decoder = Decoder(types[name])
        self._rows = {
            field: row
            for field, row in fields_of(types.declarations.get(name, {})).items()
            if parts_of(row["type"])[1][:1] == [_PER_NAME]
        }
        self.names: Sequence[str] = ()

    def problem(self, message: Message, data: bytes) -> str:
        """Return the problem of a message; empty: there is none. data: the message, encoded."""
        try:
            self._decoder.plain(data)
        except UNDECODABLE as exc:
            return str(self._decoder.error(exc))
        for field, row in self._rows.items():
            value = getattr(message, field)
            if value == row.get("default") or len(value) == len(self.names) or not self.names:
                continue
            names = f"{len(self.names)} names ({', '.join(self.names)})"
            return f"{field} has {len(value)} values for the {names} of the port's description"
        return ""


class OutputPorts:
    """Checks and encodes the messages of a participant's output ports.

    classes: port → its class. checks: of the ports whose messages are decoded to check them.
    decodes_all: these are all; else only those of the user's own types, and the readers find the
    rest.
    """

    def __init__(
        self, ports: Mapping[str, OutputConfig], types: Types, *, decodes_all: bool = False
    ) -> None:
        self.classes = {port: types[config.type] for port, config in ports.items()}
        self.checks = {
            port: _TypeCheck(config.type, types)
            for port, config in ports.items()
            if decodes_all or config.type in types.declarations
        }

    def set_names(self, names: Mapping[str, Sequence[str]]) -> None:
        """Take the names of the ports' descriptions, by port."""
        for port, check in self.checks.items():
            check.names = names.get(port, ())

    def encode(self, step: int, port: str, message: Message) -> bytes:
        """Return a message of a step as bytes.

        Raises OutputError for a port that the scenario lacks, a message of another type, and a
        message that cannot be encoded or that no reader could decode.
        """
        cls = self.classes.get(port)
        if cls is None:
            known = ", ".join(self.classes) or "none"
            raise OutputError(
                f"step {step}: the scenario has no output port {port!r}; it has {known}"
            )
        if type(message) is not cls:
            raise OutputError(
                f"step {step}: port {port!r} takes {type_name(cls)}, got {type(message).__name__}"
            )
        try:
            data = encode(message)
        except _UNENCODABLE as exc:
            raise OutputError(
                f"step {step}: cannot encode port {port!r}: {explained(exc)}"
            ) from exc
        if port in self.checks and (problem := self.checks[port].problem(message, data)):
            raise OutputError(f"step {step}: port {port!r}: {problem}")
        return data


class Outbox:
    """Publishes the outputs of one participant, and logs them in batches.

    name: of the participant. step: the newest one published. drops: cause → number of dropped
    messages, which logs report. types: with those that do not ship. record_ns: time spent on logs,
    for a profile [ns]. outputs, timing: the log batch, sent at flushed_ns for the last time [ns],
    and anew after `batch` outputs.
    """

    def __init__(
        self, welcome: Welcome, bus: Bus, drops: Mapping[str, int], types: Types = SHIPPED
    ) -> None:
        self.step = HANDSHAKE_STEP
        self.record_ns = self.flushed_ns = 0
        self._bus = bus
        self._now_ns = bus.clock.monotonic_ns
        # Of every message: what it needs is looked up once.
        self.name, self._token, self._step_ns = welcome.name, welcome.token, welcome.step_ns
        self.batch, self._max_bytes = welcome.batch, welcome.max_outputs_bytes
        self._every = welcome.every
        self._drops = drops
        self._ports = OutputPorts(welcome.outputs, types)
        self._put = bus.publisher(f"out/{welcome.name}", encoding_of("Outputs/1"))
        self._put_batch = self._put
        self._most_held = 1
        self._held: list[msgspec.Raw] = []
        self._held_bytes = 0
        self._held_ns = 0
        self._put_log = bus.publisher(f"log/{welcome.name}", encoding_of("Log/1"))
        self._put_bulk = {
            port: bus.publisher(f"bulk/{welcome.name}/{port}", encoding_of(config.type))
            for port, config in welcome.outputs.items()
            if config.bulk
        }
        self._slots: Mapping[str, SlotWriter] = {}
        self._hand_over: Callable[..., None] | None = None
        self.outputs: list[Any] = []
        self._bytes = 0
        self._age_ns = 0
        self.timing: list[tuple[int, int, int]] = []

    def send_handshake(self) -> None:
        """Prove the links to all consumers, before the first step (P4.6)."""
        self._put(self._pack(HANDSHAKE_STEP, {}, {}, None))
        for put in self._put_bulk.values():
            put(b"", attachment=stamp(HANDSHAKE_STEP, self._token))

    def inject(self, faults: Sequence[MessageFault]) -> None:
        """Delay, repeat, damage or drop some outputs; the log stays intact."""
        from .faulty import FaultyPublisher  # noqa: PLC0415  (few runs have faults)

        self._put = self._put_batch = FaultyPublisher(self._put, faults, self._bus.clock)

    def start(
        self, names: Mapping[str, Sequence[str]], slots: Mapping[str, SlotWriter], most_held: int
    ) -> None:
        """Take what the start of the run says.

        names: port → the names of its description. slots: write the content of these bulk ports
        (P17). most_held: how many steps may go out in one message, since no participant waits for
        them (P7.6).
        """
        self._ports.set_names(names)
        self._slots = slots
        if most_held > 1:
            self._most_held = most_held
            self._put_batch = self._bus.publisher(f"out/{self.name}", encoding_of("Batch/1"))

    def join(self, exchange: Any) -> Callable[..., None]:
        """Have the outputs of all steps go to readers in this thread, without a bus between.

        Return what publishes them, as `publish` does. All that it needs is looked up here.
        """
        name, token, step_ns, every = self.name, self._token, self._step_ns, self._every
        self.batch, self.flushed_ns = min(self.batch, _HANDED_OVER), self._now_ns()
        waiting, place = exchange.waiting[name], exchange.places[name]
        known, words, let_go_on = exchange.known, exchange.words, exchange.turns.let_go_on
        classes, checked, keep = self._ports.classes, self._ports.encode, self.outputs.append
        most = self._max_bytes - _ENVELOPE_BYTES
        most -= sum(_PORT_BYTES + len(port.encode()) for port in classes)
        rows = {
            port: (None if port in self._ports.checks else cls, exchange.readers.get((name, port)))
            for port, cls in classes.items()
        }

        def hand_over(step: int, messages: Mapping[str, Message] | None, end: str | None) -> None:
            ports: dict[str, Any] = {}
            size = 0
            if messages:
                for port, message in messages.items():
                    try:
                        cls, readers = rows[port]
                        is_plain = type(message) is cls
                        data = encode(message) if is_plain else checked(step, port, message)
                    except _UNENCODABLE:
                        # It says which one.
                        data = checked(step, port, message)
                    size += len(data)
                    ports[port] = data
                    if readers:
                        for pending in readers:
                            pending.append((step, data))
            outputs = Outputs(token=token, step=step, t_ns=step * step_ns, ports=ports, end=end)
            if size > most or end is not None:
                raw = {port: msgspec.Raw(data) for port, data in ports.items()}
                self._check_size(step, len(encode(msgspec.structs.replace(outputs, ports=raw))))
            self.step = step
            keep(outputs)
            known[name] = words[place] = step + every
            while waiting:
                let_go_on(waiting.popleft())

        self._hand_over = hand_over
        return hand_over

    def publish(
        self, step: int, messages: Mapping[str, Message] | None, end: str | None = None
    ) -> None:
        """Publish the outputs of a step, and add them to the log batch.

        end: why the run should end after this step. Raises OutputError when a port or its type is
        not the scenario's, or when the outputs are too large.
        """
        if self._hand_over is not None:
            self._hand_over(step, messages, end)
            return
        ports: dict[str, msgspec.Raw] = {}
        bulk: dict[str, int] = {}
        slots: dict[str, int] = {}
        for port, message in (messages or {}).items():
            data = self._ports.encode(step, port, message)
            if port in self._slots:
                bulk[port] = len(data)
                slots[port] = self._slots[port].write(step, data)
            elif port in self._put_bulk:
                bulk[port] = len(data)
                self._put_bulk[port](data, attachment=stamp(step, self._token))
            else:
                ports[port] = msgspec.Raw(data)
        packed = self._pack(step, ports, bulk, end, slots)
        size = len(packed)
        self._check_size(step, size)
        entry = msgspec.Raw(packed)
        if self._most_held > 1:
            if self._held_bytes + size > BATCH_BYTES:
                self.send_held()
            self._held.append(entry)
            self._held_bytes += size
        else:
            self._put(packed)
        self.step = step
        if self._bytes + size > BATCH_BYTES:
            self.flush()
        self.outputs.append(entry)
        self._bytes += size

    def _check_size(self, step: int, size: int) -> None:
        if size > self._max_bytes:
            raise OutputError(
                f"step {step}: outputs of {size} bytes exceed the bus's limit of "
                f"{self._max_bytes}; declare the large port {{bulk: true}}"
            )

    def send_held(self) -> None:
        """Publish the outputs that are held; to be called before each wait."""
        held, self._held, self._held_bytes, self._held_ns = self._held, [], 0, 0
        if len(held) == 1:
            self._put(bytes(held[0]))
        elif held:
            self._put_batch(encode(Batch(token=self._token, outputs=held)))

    def _pack(
        self,
        step: int,
        ports: dict[str, msgspec.Raw],
        bulk: dict[str, int],
        end: str | None,
        slots: Mapping[str, int] = {},
    ) -> bytes:
        return encode(
            Outputs(
                token=self._token,
                step=step,
                t_ns=step * self._step_ns if step >= 0 else 0,
                ports=ports,
                bulk=bulk,
                slots=dict(slots),
                end=end,
            )
        )

    def finish(self, step: int, waited_ns: int, computed_ns: int) -> None:
        """Add the timing of a finished step, and send the batch when it is full or old."""
        self.timing.append((step, waited_ns, computed_ns))
        self._age_ns += waited_ns + computed_ns
        if self._held:
            self._held_ns += waited_ns + computed_ns
            if len(self._held) >= self._most_held or self._held_ns > HOLD_NS:
                self.send_held()
        if len(self.outputs) >= self.batch or self._age_ns > BATCH_AGE_NS:
            self.flush()

    def flush_full(self) -> None:
        """Send the batch if it is full; one that publishes first does so before it waits."""
        if len(self.outputs) >= self.batch:
            self.flush()

    def flush(self, waiting: Waiting | None = None) -> None:
        """Send the batch, and report what the participant waits for."""
        start_ns = self.flushed_ns = self._now_ns()
        # Nothing is logged before it is published.
        self.send_held()
        log = Log(
            name=self.name,
            token=self._token,
            outputs=self.outputs.copy(),
            timing=self.timing.copy(),
            waiting=waiting,
            drops=dict(self._drops),
        )
        self._put_log(encode(log) if self._hand_over is None else log)
        self.outputs.clear()
        self.timing.clear()
        self._bytes, self._age_ns = 0, 0
        if waiting is None:
            # A batch that is sent during a wait is part of the wait.
            self.record_ns += self._now_ns() - start_ns
