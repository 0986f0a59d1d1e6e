"""Writes the recording of a run: channels, outputs, calls and hash chains (P13)."""

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import takewhile
from math import inf
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec

from stepbus_orchestrator.errors import ParticipantFault
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import HashChain, messages_sha256, step_key, summed
from stepbus_orchestrator.recording.mcap_file import McapFile
from stepbus_orchestrator.recording.sink import Descriptions, Published, Sink
from stepbus_orchestrator.scenario.model import ParticipantSpec, partly_recorded
from stepbus_schemas import (
    SHIPPED,
    UNDECODABLE,
    CallRecord,
    Chain,
    Decoder,
    Description,
    Event,
    Message,
    Types,
    encode,
    json_schema,
    viewing,
)

OnEvent = Callable[[str, str, int, Event], None]
"""Takes (participant, port, step, event)."""


class _Port(NamedTuple):
    channel: int
    decode: Callable[[bytes | msgspec.Raw], Message]
    on_event: Callable[[str, str, int, Any], None] | None
    key: bytes


class _Source(NamedTuple):
    """A participant: its hash chain, every how many steps it publishes, and its ports by name."""

    chain: HashChain
    every: int
    ports: dict[str, _Port]


class Recorder(Sink):
    """Writes the outputs of a run, and the hash chains.

    order: the participants in schedule order. on_event: gets every Event that is written. types:
    those of the scenario. versions: participant → library → version, of those that do not run.
    Its methods raise RecordingFailed when the disk is full or the recording is closed, and
    ParticipantFault when a message is not of its port's type.
    """

    def __init__(
        self,
        file: McapFile,
        order: Sequence[ParticipantSpec],
        step_ns: int,
        on_event: OnEvent | None = None,
        types: Types = SHIPPED,
        *,
        versions: Mapping[str, Mapping[str, str]] = MappingProxyType({}),
    ) -> None:
        super().__init__({spec.name: spec.outputs for spec in order}, partly_recorded(order))
        self._types = types
        self._file = file
        self._add = file.add_all
        self._specs = {spec.name: spec for spec in order}
        self._step_ns = step_ns
        self._on_event = on_event
        self._versions = versions
        self._sources = {spec.name: _Source(HashChain(), spec.every, {}) for spec in order}
        self._silent = {
            (spec.name, port)
            for spec in order
            for port in spec.outputs
            if port not in self._partly.get(spec.name, ())
        }
        self._missing = dict.fromkeys(self._specs, 0)
        self._chain_channel: int | None = None
        self._last_chain = b""
        self._calls_channel: int | None = None
        self._is_aborting = False
        self._facts: deque[tuple[int, str, Mapping[str, str]]] = deque()

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Register one channel per port, and record what the participants run on.

        descriptions: participant → port → its description. versions: participant → library →
        version.
        """
        for name in self._specs:
            own = versions.get(name, self._versions.get(name, {}))
            content = dict(sorted(own.items()))
            self._file.add_metadata(layout.versions_metadata(name), content)
        for name, spec in self._specs.items():
            for port, output in spec.outputs.items():
                description = descriptions.get(name, {}).get(port, Description())
                channel = self._file.add_channel(
                    layout.topic_of(name, port),
                    output.type,
                    layout.channel_metadata(
                        name,
                        port,
                        msgspec.json.encode(description).decode(),
                        output.record if output.record_every != 1 else "",
                    ),
                    partial(json_schema, types=self._types),
                )
                cls = self._types[output.type]
                on_event = self._on_event if issubclass(cls, Event) else None
                checked = viewing(cls) if output.bulk and on_event is None else cls
                self._sources[name].ports[port] = _Port(
                    channel, Decoder(checked).plain, on_event, port.encode()
                )
        self._chain_channel = self._file.add_channel(layout.CHAIN_TOPIC, layout.CHAIN_TYPE, {})

    def add_metadata(self, name: str, content: Mapping[str, str], before: int = 0) -> None:
        """Write a metadata record, before the messages of a step: whatever has arrived by now."""
        self._facts.append((before, name, content))
        self._write_facts(self._next)

    def _write_facts(self, step: float) -> None:
        while self._facts and self._facts[0][0] <= step:
            _, name, content = self._facts.popleft()
            self._file.add_metadata(name, content)

    def write_call(self, call: CallRecord) -> None:
        """Write a call, before the outputs of its step."""
        if self._calls_channel is None:
            self._calls_channel = self._file.add_channel(layout.CALLS_TOPIC, layout.CALLS_TYPE, {})
        self._add([(self._calls_channel, encode(call))], call.step * self._step_ns, call.step)

    @property
    def messages_sha256(self) -> str:
        """Return the SHA-256 of all messages (P13.3); empty if no chain covers the last step."""
        return messages_sha256(self._last_chain) if self._last_chain else ""

    @property
    def silent(self) -> frozenset[tuple[str, str]]:
        """Return the ports without a message, as (participant, port), of those recorded whole."""
        return frozenset(self._silent)

    def flush(self) -> None:
        """Write all that is in order, so that the file has it even after a kill."""
        self._file.flush()

    def finish(self, closing_step: int, closing: Collection[str]) -> None:
        """Write what is left, with the last chain, and close the file."""
        try:
            super().finish(closing_step, closing)
        except BaseException:
            self.abort()
            raise
        self._file.close()

    def abort(self) -> None:
        """Write whatever has arrived, without a hole, and what has not; close the file."""
        if self._file.closed:
            return
        self._is_aborting = True
        for name, own in self._waiting.items():
            # Nothing follows something broken, or bulk content that is missing.
            whole = takewhile(partial(self._has_bulk, name), own)
            self._waiting[name] = deque() if self.has_broken(name) else deque(whole)
        steps = [outputs.step for own in self._waiting.values() for outputs in own]
        last = max(steps, default=-1)
        try:
            # A chain may be due at a step at which no participant publishes.
            for step in range(min([self._next, *steps]), last + 1):
                self.write_step(step, is_last=step == last)
            self._write_facts(inf)
        finally:
            missing = {name: str(step) for name, step in self._missing.items()}
            has_begun = self._chain_channel is not None
            self._file.close(missing if has_begun else None)

    def write_step(
        self, step: int, closing: Collection[str] | None = None, *, is_last: bool = False
    ) -> None:
        """Write the outputs of a step up to the first broken one, and the chain where it is due.

        is_last: whether it is due in any case, as at the closing step.
        """
        self._last_chain = b""
        self._write_facts(step)
        messages: list[tuple[int, bytes]] = []
        try:
            try:
                if self.reviser is None:
                    self._collect_all(step, messages)
                else:
                    for published in self.revised(step, closing):
                        self._collect(published, messages)
            finally:
                self._add(messages, step * self._step_ns, step)
            is_due = is_last or closing is not None or layout.has_chain(step)
            if is_due and self._chain_channel is not None:
                hashes = {name: source.chain.value.hex() for name, source in self._sources.items()}
                self._last_chain = encode(Chain(step=step, hashes=hashes))
                self._add([(self._chain_channel, self._last_chain)], step * self._step_ns, step)
        except MemoryError as exc:
            # Outputs that were taken from the queue may be lost: nothing may follow them.
            raise self._file.refuse(exc) from exc

    def _collect_all(self, step: int, messages: list[tuple[int, bytes]]) -> None:
        """Check what all have published at a step, and append it; called for every step."""
        silent, sources, step_bytes = self._silent, self._sources, step_key(step)
        for name, own in self._waiting.items():
            if not own or own[0].step != step:
                continue
            outputs, known = own.popleft(), len(messages)
            if outputs.bulk or name in self._partly or name in self._broken:
                self._collect(self._published(name, outputs), messages)
                continue
            chain, every, ports = sources[name]
            parts, plain, events = [chain.value, step_bytes], outputs.ports, []
            try:
                for port, (channel, decode, on_event, key) in ports.items():
                    if port not in plain:
                        continue
                    data = plain[port]
                    message = decode(data)
                    messages.append((channel, data))
                    parts += (key, data)
                    if silent:
                        silent.discard((name, port))
                    if on_event is not None:
                        events.append((on_event, port, message))
            except UNDECODABLE:
                # That says what is wrong.
                del messages[known:]
                self._collect(self._published(name, outputs), messages)
                continue
            chain.value = summed(parts)
            self._missing[name] = step + every
            for on_event, port, message in events:
                on_event(name, port, step, message)

    def _collect(self, published: Published, messages: list[tuple[int, bytes]]) -> None:
        """Check what one participant has published, and append it as (channel, content)."""
        name, step, content = published.participant, published.step, published.content
        chain, every, ports = self._sources[name]
        silent = self._silent
        fault, cause, number = published.fault, None, 0
        try:
            for port, data in content:
                channel, decode, on_event, _ = ports[port]
                message = decode(data)
                number += 1
                messages.append((channel, data))
                if silent:
                    silent.discard((name, port))
                if on_event is not None:
                    on_event(name, port, step, message)
        except UNDECODABLE as exc:
            self.broke(name)
            port, cause = content[number][0], exc
            error = Decoder(self._types[self._specs[name].outputs[port].type]).error(exc)
            t_s = step * self._step_ns * 1e-9
            text = f"step {step} (t = {t_s:.3f} s): {name}.{port} is {error}"
            fault = ParticipantFault(text, participant=name, step=step)
        finally:
            valid = content if number == len(content) else content[:number]
            chain.extend(step, valid)
        if fault is None:
            self._missing[name] = step + every
        elif not self._is_aborting:
            # A second broken message must not hide the first, which ended the run.
            raise fault from cause
