"""Writes run.mcap: the outputs of all participants, in an order that no timing can change."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
from mcap.writer import CompressionType, IndexType

from stepbus_orchestrator.errors import ParticipantFault, RecordingFailed
from stepbus_orchestrator.run.events import Events
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_schemas import (
    CallRecord,
    Decoder,
    Description,
    Event,
    MessageError,
    Outputs,
    encode,
    message_class,
)
from stepbus_schemas.protocol import CHAIN_EVERY, Chain
from stepbus_schemas.schema import json_schema

from .message_writer import MessageWriter
from .reserved_file import SteadyFile

CHUNK_BYTES = 64 * 1024
CHAIN_TOPIC = "stepbus/chain"
CALLS_TOPIC = "stepbus/calls"
VERSIONS_METADATA = "versions/"


class McapFile:
    """An MCAP file of MessagePack messages with JSON Schemas, and nothing that differs by run.

    Raises RecordingFailed, with what to do, when it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._schemas: dict[str, int] = {}
        try:
            self._file = SteadyFile(path)
            sink: Any = self._file
            self._writer: Any = MessageWriter(
                sink,
                chunk_size=CHUNK_BYTES,
                compression=CompressionType.ZSTD,
                index_types=IndexType.ALL,
            )
            self._writer.start(profile="", library="stepbus")
        except OSError as exc:
            raise self._failure(exc) from exc

    def _failure(self, exc: OSError) -> RecordingFailed:
        return RecordingFailed(
            f"the recording {self.path} cannot be written: {exc.strerror or exc}; "
            "free some disk space or choose another folder with --out"
        )

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file."""
        try:
            self._writer.add_attachment(
                create_time=0, log_time=0, name=name, media_type=media_type, data=data
            )
        except OSError as exc:
            raise self._failure(exc) from exc

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a metadata record."""
        try:
            self._writer.add_metadata(name, dict(content))
        except OSError as exc:
            raise self._failure(exc) from exc

    def add_channel(
        self,
        topic: str,
        type_name: str,
        metadata: Mapping[str, str],
        schema_of: Callable[[str], Mapping[str, Any]] = json_schema,
    ) -> int:
        """Register a channel and, once, its type's JSON Schema; return the channel's number."""
        if type_name not in self._schemas:
            schema = json.dumps(schema_of(type_name), sort_keys=True, ensure_ascii=False)
            self._schemas[type_name] = self._writer.register_schema(
                f"stepbus.{type_name}", "jsonschema", schema.encode()
            )
        channel: int = self._writer.register_channel(
            topic, "msgpack", self._schemas[type_name], dict(metadata)
        )
        return channel

    def add(self, channel: int, t_ns: int, data: bytes, sequence: int) -> None:
        """Write one message."""
        try:
            self._writer.add_message(channel, t_ns, data, t_ns, sequence)
        except OSError as exc:
            raise self._failure(exc) from exc

    def close(self) -> None:
        """Write what is left and the index; on a full disk, in the room that was set aside."""
        if self._file.closed:
            return
        self._file.release()
        try:
            self._writer.finish()
        except OSError as exc:
            raise self._failure(exc) from exc
        finally:
            self._file.close()


class _Lane:
    """The outputs of one participant on their way into the recording."""

    def __init__(self, spec: ParticipantSpec) -> None:
        self.name = spec.name
        self.every = spec.every
        self.ports = list(spec.outputs)
        self.channels: dict[str, int] = {}
        self.decoders = {
            port: Decoder(message_class(output.type)) for port, output in spec.outputs.items()
        }
        self.waiting: deque[Outputs] = deque()
        self.bulk: dict[tuple[int, str], bytes] = {}
        self.chain = bytes(32)

    def has_bulk(self, outputs: Outputs) -> bool:
        """Return whether all bulk content of these outputs has arrived."""
        return all((outputs.step, port) in self.bulk for port in outputs.bulk)

    def take(self, outputs: Outputs) -> list[tuple[str, bytes]]:
        """Return what was published, by port in the scenario's order, and move the chain on."""
        content: list[tuple[str, bytes]] = []
        digest = hashlib.sha256(self.chain)
        digest.update(outputs.step.to_bytes(8, "little", signed=True))
        for port in self.ports:
            raw: Any = outputs.ports.get(port)
            if raw is None:
                raw = self._take_bulk(outputs, port)
            if raw is not None:
                data = bytes(raw)
                digest.update(port.encode())
                digest.update(data)
                content.append((port, data))
        self.chain = digest.digest()
        return content

    def _take_bulk(self, outputs: Outputs, port: str) -> bytes | None:
        content = self.bulk.pop((outputs.step, port), None)
        announced = outputs.bulk.get(port)
        if content is not None and len(content) != announced:
            raise ParticipantFault(
                f"step {outputs.step}: {self.name} announced {announced} bytes on bulk port "
                f"{port!r} and sent {len(content)}",
                participant=self.name,
                step=outputs.step,
            )
        return content


class Recorder:
    """Orders outputs by (step, schedule order, port) and writes them.

    order: the participants in schedule order. events: is told of every Event that is written.
    Raises RecordingFailed when the disk is full, and ParticipantFault when a message is not of its
    port's type.
    """

    def __init__(
        self,
        file: McapFile,
        order: list[ParticipantSpec],
        step_ns: int,
        events: Events | None = None,
    ) -> None:
        self._file = file
        self._events = events
        self._step_ns = step_ns
        self._lanes = {spec.name: _Lane(spec) for spec in order}
        self._types = {spec.name: spec.outputs for spec in order}
        self._has_bulk = any(out.bulk for spec in order for out in spec.outputs.values())
        self._next = 0
        self._chain_channel = -1
        self._calls_channel = -1

    def open_channels(
        self,
        descriptions: Mapping[str, Mapping[str, Description]],
        versions: Mapping[str, Mapping[str, str]],
    ) -> None:
        """Register one channel per port, and note what the participants run on.

        descriptions: participant → port → its description. versions: participant → library →
        version.
        """
        for name in self._lanes:
            content = dict(sorted(versions.get(name, {}).items()))
            self._file.add_metadata(f"{VERSIONS_METADATA}{name}", content)
        for lane in self._lanes.values():
            for port in lane.ports:
                description = descriptions.get(lane.name, {}).get(port, Description())
                metadata = {
                    "participant": lane.name,
                    "port": port,
                    "description": msgspec.json.encode(description).decode(),
                }
                type_name = self._types[lane.name][port].type
                lane.channels[port] = self._file.add_channel(
                    f"{lane.name}/{port}", type_name, metadata
                )
        self._chain_channel = self._file.add_channel(CHAIN_TOPIC, "Chain/1", {})

    def note(self, name: str, content: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._file.add_metadata(name, content)

    def note_call(self, call: CallRecord) -> None:
        """Write a call that changed something, before the outputs of its step."""
        if self._calls_channel < 0:
            self._calls_channel = self._file.add_channel(CALLS_TOPIC, "CallRecord/1", {})
        self._file.add(self._calls_channel, call.step * self._step_ns, encode(call), call.step)

    def offer(self, name: str, outputs: Outputs) -> None:
        """Keep the outputs of one participant until their turn comes."""
        self._lanes[name].waiting.append(outputs)

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Keep the content of a bulk port until its turn comes."""
        self._lanes[name].bulk[(step, port)] = content

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""
        return all(lane.has_bulk(o) for lane in self._lanes.values() for o in lane.waiting)

    def write_below(self, step: int) -> None:
        """Write all steps below `step`, as far as their bulk content is there."""
        while self._next < step and (not self._has_bulk or self._is_whole(self._next)):
            self._write_step(self._next, sequence_end=False)
            self._next += 1

    def finish(self, closing_step: int, closing: list[str]) -> None:
        """Write the closing outputs of those named, the last chain, and close the file."""
        try:
            self.write_below(closing_step)
            for lane in self._lanes.values():
                lane.waiting = deque(o for o in lane.waiting if lane.name in closing)
            self._write_step(closing_step, sequence_end=True)
        finally:
            self._file.close()

    def abort(self) -> None:
        """Write whatever has arrived, in order, and close the file."""
        steps = sorted({o.step for lane in self._lanes.values() for o in lane.waiting})
        try:
            for step in steps:
                # A second broken message must not hide the first, which ended the run.
                with contextlib.suppress(ParticipantFault):
                    self._write_step(step, sequence_end=step == steps[-1])
        finally:
            self._file.close()

    def _is_whole(self, step: int) -> bool:
        heads = [lane for lane in self._lanes.values() if lane.waiting]
        return all(lane.has_bulk(lane.waiting[0]) for lane in heads if lane.waiting[0].step == step)

    def _write_step(self, step: int, *, sequence_end: bool) -> None:
        for lane in self._lanes.values():
            while lane.waiting and lane.waiting[0].step == step:
                self._write(lane, lane.waiting.popleft())
        if self._chain_channel >= 0 and (sequence_end or (step + 1) % CHAIN_EVERY == 0):
            hashes = {name: lane.chain.hex() for name, lane in self._lanes.items()}
            data = encode(Chain(step=step, hashes=hashes))
            self._file.add(self._chain_channel, step * self._step_ns, data, step)

    def _write(self, lane: _Lane, outputs: Outputs) -> None:
        t_ns = outputs.step * self._step_ns
        for port, data in lane.take(outputs):
            try:
                message = lane.decoders[port](data)
            except MessageError as exc:
                raise ParticipantFault(
                    f"step {outputs.step} (t = {t_ns * 1e-9:.3f} s): {lane.name}.{port} is {exc}",
                    participant=lane.name,
                    step=outputs.step,
                ) from exc
            self._file.add(lane.channels[port], t_ns, data, outputs.step)
            if self._events is not None and isinstance(message, Event):
                self._events.take(lane.name, port, outputs.step, message)
