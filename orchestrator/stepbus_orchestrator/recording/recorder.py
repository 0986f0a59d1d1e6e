"""The seam between a run and what becomes of its outputs."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import msgspec

from stepbus_orchestrator.errors import ParticipantFault
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import HashChain, messages_sha256
from stepbus_orchestrator.recording.mcap_file import McapFile
from stepbus_orchestrator.recording.step_order import Published, StepOrder
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_schemas import (
    SHIPPED,
    UNDECODABLE,
    CallRecord,
    Chain,
    Decoder,
    Description,
    Event,
    Message,
    Outputs,
    Types,
    encode,
    json_schema,
)

Descriptions = Mapping[str, Mapping[str, Description]]
"""Participant → output → its description."""


class Sink(Protocol):
    """Takes the outputs of participants: a recorder, or a comparison with a recording."""

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Take how the participants describe their outputs, and what they run on."""

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Take a fact about the run that is no message."""

    def add_call(self, call: CallRecord) -> None:
        """Take a call that changed something; all steps before its own are written."""

    def offer(self, name: str, outputs: Outputs) -> None:
        """Take the outputs of one participant, which come in the order of their steps."""

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Take the content of a bulk port, before or after the outputs that announce it."""

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""

    def write_below(self, step: int) -> None:
        """Process all steps below `step`: they are complete."""

    def flush(self) -> None:
        """Keep what is processed safe from a kill; called by the wall clock, changes no result."""

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """End at `closing_step`; closing: who published once more at it."""


OnEvent = Callable[[str, str, int, Event], None]
"""Takes (participant, port, step, event)."""


class _Port(NamedTuple):
    channel: int
    decode: Callable[[bytes | msgspec.Raw], Message]
    on_event: Callable[[str, str, int, Any], None] | None


class Recorder:
    """Writes outputs by (step, schedule order, port), and the hash chains (P13).

    order: the participants in schedule order. on_event: gets every Event that is written. types:
    those of the scenario.
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
    ) -> None:
        self._types = types
        self._file = file
        self._add = file.add_all
        self._specs = {spec.name: spec for spec in order}
        self._step_ns = step_ns
        self._on_event = on_event
        self._order = StepOrder({spec.name: list(spec.outputs) for spec in order})
        self._chains = {spec.name: HashChain() for spec in order}
        self._ports: dict[str, dict[str, _Port]] = {spec.name: {} for spec in order}
        self._silent = {(spec.name, port) for spec in order for port in spec.outputs}
        self._chain_channel: int | None = None
        self._last_chain = b""
        self._calls_channel: int | None = None

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Register one channel per port, and record what the participants run on.

        descriptions: participant → port → its description. versions: participant → library →
        version.
        """
        for name in self._specs:
            content = dict(sorted(versions.get(name, {}).items()))
            self._file.add_metadata(layout.versions_metadata(name), content)
        for name, spec in self._specs.items():
            for port, output in spec.outputs.items():
                description = descriptions.get(name, {}).get(port, Description())
                channel = self._file.add_channel(
                    layout.topic_of(name, port),
                    output.type,
                    layout.channel_metadata(name, port, msgspec.json.encode(description).decode()),
                    partial(json_schema, types=self._types),
                )
                cls = self._types[output.type]
                on_event = self._on_event if issubclass(cls, Event) else None
                self._ports[name][port] = _Port(channel, Decoder(cls).plain, on_event)
        self._chain_channel = self._file.add_channel(layout.CHAIN_TOPIC, layout.CHAIN_TYPE, {})

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._file.add_metadata(name, content)

    def add_call(self, call: CallRecord) -> None:
        """Write a call that changed something, before the outputs of its step (P15.5)."""
        if self._calls_channel is None:
            self._calls_channel = self._file.add_channel(layout.CALLS_TOPIC, layout.CALLS_TYPE, {})
        self._add([(self._calls_channel, encode(call))], call.step * self._step_ns, call.step)

    @property
    def messages_sha256(self) -> str:
        """Return the SHA-256 of all messages (P13.3); empty where no chain closes the last step."""
        return messages_sha256(self._last_chain) if self._last_chain else ""

    @property
    def silent(self) -> frozenset[tuple[str, str]]:
        """Return the ports without a message, as (participant, port)."""
        return frozenset(self._silent)

    def offer(self, name: str, outputs: Outputs) -> None:
        """Keep the outputs of one participant until their step is written."""
        self._order.offer(name, outputs)

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Keep the content of a bulk port until its step is written."""
        self._order.offer_bulk(name, port, step, content)

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""
        return self._order.bulk_complete()

    def write_below(self, step: int) -> None:
        """Write all steps below `step`, up to the first that lacks bulk content."""
        for complete in self._order.complete_below(step):
            self._write_step(complete, is_last=False)

    def flush(self) -> None:
        """Let the file have all that is written, even if this process is killed."""
        self._file.flush()

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """Write the closing outputs of those named, the last chain, and close the file.

        What a participant published behind the closing step is no part of the run and is dropped.
        """
        try:
            self.write_below(closing_step)
            self._order.end(closing_step, closing)
            self._write_step(closing_step, is_last=True)
        finally:
            self.abort()

    def abort(self) -> None:
        """Write whatever has arrived, in order, and close the file; harmless when repeated."""
        if self._file.closed:
            return
        steps = self._order.steps()
        try:
            for step in steps:
                self._write_what_is_valid(step)
                self._write_chain(step, is_last=step == steps[-1])
        finally:
            self._file.close()

    def _write_what_is_valid(self, step: int) -> None:
        # A second broken message must not hide the first, which ended the run.
        is_complete = False
        while not is_complete:
            with contextlib.suppress(ParticipantFault):
                self._write_outputs(step)
                is_complete = True

    def _write_step(self, step: int, *, is_last: bool) -> None:
        self._write_outputs(step)
        self._write_chain(step, is_last=is_last)

    def _write_outputs(self, step: int) -> None:
        """Write the outputs of one step, up to the first broken one; the chains have the same."""
        self._last_chain = b""
        messages: list[tuple[int, bytes]] = []
        try:
            for published in self._order.take(step):
                self._collect(published, messages)
        finally:
            self._add(messages, step * self._step_ns, step)

    def _collect(self, published: Published, messages: list[tuple[int, bytes]]) -> None:
        """Check what one participant has published, and append it as (channel, content)."""
        name, content = published.participant, published.content
        ports, silent = self._ports[name], self._silent
        number = 0
        try:
            for port, data in content:
                channel, decode, on_event = ports[port]
                message = decode(data)
                number += 1
                messages.append((channel, data))
                if silent:
                    silent.discard((name, port))
                if on_event is not None:
                    on_event(name, port, published.step, message)
        except UNDECODABLE as exc:
            raise self._broken(name, content[number][0], published.step, exc) from exc
        finally:
            valid = content if number == len(content) else content[:number]
            self._chains[name].extend(published.step, valid)
        if published.fault is not None:
            raise published.fault

    def _write_chain(self, step: int, *, is_last: bool) -> None:
        if self._chain_channel is not None and (is_last or layout.has_chain(step)):
            hashes = {name: chain.value.hex() for name, chain in self._chains.items()}
            self._last_chain = encode(Chain(step=step, hashes=hashes))
            self._add([(self._chain_channel, self._last_chain)], step * self._step_ns, step)

    def _broken(self, name: str, port: str, step: int, exc: Exception) -> ParticipantFault:
        error = Decoder(self._types[self._specs[name].outputs[port].type]).error(exc)
        t_s = step * self._step_ns * 1e-9
        return ParticipantFault(
            f"step {step} (t = {t_s:.3f} s): {name}.{port} is {error}",
            participant=name,
            step=step,
        )
