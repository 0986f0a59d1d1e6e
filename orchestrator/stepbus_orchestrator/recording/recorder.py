"""What becomes of the outputs of a run: they are put in order, and recorded."""

import contextlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import msgspec

from stepbus_orchestrator.errors import ParticipantFault, RunFailure
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import HashChain, messages_sha256
from stepbus_orchestrator.recording.mcap_file import McapFile
from stepbus_orchestrator.recording.step_order import Published, StepOrder
from stepbus_orchestrator.scenario.model import ParticipantSpec
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
)

Descriptions = Mapping[str, Mapping[str, Description]]
"""Participant → output → its description."""


class Reviser(Protocol):
    """Sees all that is about to be recorded, and may put something else in its place."""

    def revise(
        self, step: int, published: Sequence[Published], closing: Collection[str] | None
    ) -> Sequence[Published]:
        """Return what is recorded of a step, in schedule order.

        closing: at the closing step, who publishes at it. A RunFailure that it raises ends the
        recording before the step.
        """

    def revise_call(self, call: CallRecord) -> CallRecord:
        """Return what is recorded of a call."""


class Sink(StepOrder):
    """Takes what a run has to keep, in whatever order it arrives, and writes it in order (P13.1).

    order: the participants in schedule order. reviser: sees each step before it is written.

    This one checks bulk content, and writes nothing; a `Recorder` does. Methods raise
    ParticipantFault for bulk content of another length than announced.
    """

    def __init__(self, order: Sequence[ParticipantSpec]) -> None:
        super().__init__({spec.name: list(spec.outputs) for spec in order})
        self.reviser: Reviser | None = None

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Take how the participants describe their outputs, and what they run on."""

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a fact about the run that is no message."""

    def add_call(self, call: CallRecord) -> None:
        """Write a call that changed something; all steps before its own are written (P15.5)."""
        self.write_call(call if self.reviser is None else self.reviser.revise_call(call))

    def write_call(self, call: CallRecord) -> None:
        """Write a call as it is."""

    def flush(self) -> None:
        """Keep what is written safe from a kill; called by the wall clock, changes no result."""

    def write_below(self, step: int) -> None:
        """Write all steps below `step`, up to the first that lacks bulk content."""
        for complete in self.complete_below(step):
            self.write_step(complete)

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """Write what is left: up to `closing_step`, and at that the outputs of those named.

        What a participant published behind the closing step is no part of the run and is dropped.
        """
        self.write_below(closing_step)
        self.drop_behind(closing_step, closing)
        self.write_step(closing_step, closing)

    def abort(self) -> None:
        """Write whatever has arrived, in order; harmless when repeated."""
        for step in self.steps():
            self.write_step(step)

    def write_step(self, step: int, closing: Collection[str] | None = None) -> None:
        """Write the outputs of a step; closing: at the last one, who publishes at it."""
        for published in self.revised(step, closing):
            if published.fault is not None:
                raise published.fault

    def revised(self, step: int, closing: Collection[str] | None = None) -> Iterable[Published]:
        """Return the outputs of a step that are to be written, and forget them."""
        if self.reviser is None:
            return self.take(step)
        try:
            return self.reviser.revise(step, list(self.take(step)), closing)
        except RunFailure:
            # Nothing follows a step that is not there.
            self.drop_behind(-1, ())
            raise


OnEvent = Callable[[str, str, int, Event], None]
"""Takes (participant, port, step, event)."""


class _Port(NamedTuple):
    channel: int
    decode: Callable[[bytes | msgspec.Raw], Message]
    on_event: Callable[[str, str, int, Any], None] | None


class Recorder(Sink):
    """Writes outputs by (step, schedule order, port), and the hash chains (P13).

    on_event: gets every Event that is written. types: those of the scenario.
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
        super().__init__(order)
        self._types = types
        self._file = file
        self._add = file.add_all
        self._specs = {spec.name: spec for spec in order}
        self._step_ns = step_ns
        self._on_event = on_event
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

    def write_call(self, call: CallRecord) -> None:
        """Write a call, before the outputs of its step."""
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

    def flush(self) -> None:
        """Let the file have all that is written, even if this process is killed."""
        self._file.flush()

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """Write what is left, with the last chain, and close the file."""
        try:
            super().finish(closing_step, closing)
        finally:
            self.abort()

    def abort(self) -> None:
        """Write whatever has arrived, in order, and close the file; harmless when repeated."""
        if self._file.closed:
            return
        steps = self.steps()
        try:
            for step in steps:
                self._write_outputs(step, collect=self._collect_what_is_valid)
                self._write_chain(step, is_last=step == steps[-1])
        finally:
            self._file.close()

    def write_step(self, step: int, closing: Collection[str] | None = None) -> None:
        """Write the outputs of a step, and the chain behind them where it is due."""
        self._write_outputs(step, closing)
        self._write_chain(step, is_last=closing is not None)

    def _write_outputs(
        self,
        step: int,
        closing: Collection[str] | None = None,
        collect: Callable[[Published, list[tuple[int, bytes]]], None] | None = None,
    ) -> None:
        """Write the outputs of one step, up to the first broken one; the chains have the same."""
        self._last_chain = b""
        messages: list[tuple[int, bytes]] = []
        collect = collect or self._collect
        try:
            for published in self.revised(step, closing):
                collect(published, messages)
        finally:
            self._add(messages, step * self._step_ns, step)

    def _collect_what_is_valid(
        self, published: Published, messages: list[tuple[int, bytes]]
    ) -> None:
        # A second broken message must not hide the first, which ended the run.
        with contextlib.suppress(ParticipantFault):
            self._collect(published, messages)

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
