"""Makes a complete recording of one that is cut off or corrupt."""

import contextlib
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, IndexType

from stepbus_orchestrator.errors import OutputExists, RecordingFailed, argument
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.message_writer import MessageWriter
from stepbus_orchestrator.recording.reserved_file import is_being_written
from stepbus_orchestrator.recording.scanner import Scanner
from stepbus_participant import Disk, NewFile, irregular, parse_duration
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import StepbusError

from .holes import Holes


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """What was saved, and what was lost.

    damage: what is wrong with the source, empty when nothing is. cut_step: the step that it ends
    in the midst of, which is left out; None where it ends with a whole step. messages, attachments,
    metadata: how many records were kept. last_step: the newest step with a message; −1 without
    any. planned_steps: what the scenario asks for, where it is known. kept_bytes, lost_bytes: of
    the source; what is lost includes the index, which is rebuilt. only_index_lost: whether all
    messages were kept. holes: what is missing between them.
    """

    source: Path
    target: Path
    damage: str
    cut_step: int | None
    messages: int
    attachments: int
    metadata: int
    last_step: int
    planned_steps: int | None
    kept_bytes: int
    lost_bytes: int
    only_index_lost: bool
    holes: Sequence[str]

    @property
    def missing_steps(self) -> int | None:
        """Return how many steps of the scenario are missing; None where that is unknown."""
        if self.planned_steps is None:
            return None
        return 0 if self.only_index_lost else max(0, self.planned_steps - 1 - self.last_step)


def recover(source: Path, target: Path, *, in_place: bool = False, disk: Disk = os) -> Recovery:
    """Write all complete records of a recording to a new one, in the recorded order.

    source: an MCAP file, uncompressed or zstd; it is only read. target: appears when it is
    complete; may exist, or be the source, only with `in_place`. disk: writes it.

    Raises RecordingFailed when the source holds nothing to recover, OutputExists when the target
    exists already, RecordingFailed when it cannot be written, and in place of a recording that is
    being written.
    """
    if kind := irregular(target):
        raise RecordingFailed(f"{target} is {kind}: no file takes its place; name another one")
    if target.exists() and not in_place:
        raise OutputExists(
            f"{target} exists already; choose another name with {argument('--out', 'target')}"
        )
    part = target.with_name(f".{target.name}.part")
    if in_place and is_being_written(source):
        raise RecordingFailed(
            f"{source} is still being written; wait until its run has ended, or write what it has "
            f"so far to another file with {argument('--out', 'target')}"
        )
    try:
        try:
            recovery = _Copy(source, target).write(part, disk)
            disk.replace(part, target)
        finally:
            with contextlib.suppress(FileNotFoundError):
                disk.unlink(part)
    except OSError as exc:
        if isinstance(exc, RecordingFailed):
            raise
        raise RecordingFailed(
            f"{target} cannot be written: {exc.strerror or exc}; choose another file with "
            f"{argument('--out', 'target')}"
        ) from exc
    return recovery


class _Copy:
    """Writes the records of one file into another, with numbers of its own for channels."""

    def __init__(self, source: Path, target: Path) -> None:
        self._scanner = Scanner(source)
        self._target = target
        self._schemas = {0: 0}
        self._channels: dict[int, int] = {}
        self._counts = {Message: 0, Attachment: 0, Metadata: 0}
        self._last_step = -1
        self._is_ours = False
        self._is_live = is_being_written(source)
        self._newest_step = -1
        self._newest: list[McapRecord] = []
        """The messages of the newest step, and whatever stands behind the first of them."""
        self._cut_step: int | None = None
        self._planned_steps: int | None = None
        self._topics: dict[int, str] = {}
        self._holes = Holes(None)

    def write(self, part: Path, disk: Disk) -> Recovery:
        """Write all complete records to `part`; raises OSError when that cannot be written."""
        records = self._scanner.records()
        header = next(records, None)
        if not isinstance(header, Header):
            raise RecordingFailed(
                f"{self._scanner.path} has {self._scanner.size} bytes and no complete record: "
                "there is nothing to recover"
            )
        # It may replace the only copy there is: `NewFile` brings it to the medium.
        with io.BufferedWriter(NewFile(part, disk)) as file:
            # As the recorder does, so that an undamaged recording comes out byte for byte.
            writer: Any = MessageWriter(
                file,
                chunk_size=layout.CHUNK_BYTES,
                compression=CompressionType.ZSTD,
                index_types=IndexType.ALL,
                enable_data_crcs=True,
            )
            self._is_ours = header.library in layout.LIBRARIES
            library = layout.LIBRARY if self._is_ours else header.library
            writer.start(profile=header.profile, library=library)
            for record in records:
                self._take(writer, record)
            if self._newest and not self._scanner.ends_a_step:
                self._cut_newest()
            self._copy_newest(writer)
            writer.finish()
        return self._recovery()

    def _take(self, writer: Any, record: McapRecord) -> None:
        """Copy a record, a message only once it is known that nothing of its step is missing."""
        if isinstance(record, Message) and self._is_ours:
            if record.sequence != self._newest_step:
                self._copy_newest(writer)
            self._newest_step = record.sequence
            self._newest.append(record)
        elif self._newest:
            self._newest.append(record)
        else:
            self._copy(writer, record)

    def _copy_newest(self, writer: Any) -> None:
        for record in self._newest:
            self._copy(writer, record)
        self._newest.clear()

    def _cut_newest(self) -> None:
        self._cut_step = self._newest_step
        self._newest = [record for record in self._newest if not isinstance(record, Message)]

    def _copy(self, writer: Any, record: McapRecord) -> None:
        match record:
            case Message():
                self._copy_message(writer, record)
            case Channel() if record.id not in self._channels:
                self._topics[record.id] = record.topic
                self._channels[record.id] = writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    self._schemas.get(record.schema_id, 0),
                    record.metadata,
                )
            case Schema() if record.id not in self._schemas:
                number = writer.register_schema(record.name, record.encoding, record.data)
                self._schemas[record.id] = number
            case Attachment():
                self._copy_attachment(writer, record)
            case Metadata():
                self._counts[Metadata] += 1
                writer.add_metadata(record.name, record.metadata)

    def _copy_message(self, writer: Any, message: Message) -> None:
        self._counts[Message] += 1
        self._last_step = max(self._last_step, message.sequence)
        self._holes.take(self._topics[message.channel_id], message.sequence, message.data)
        writer.add_message(
            self._channels[message.channel_id],
            message.log_time,
            message.data,
            message.publish_time,
            message.sequence,
        )

    def _copy_attachment(self, writer: Any, attachment: Attachment) -> None:
        self._counts[Attachment] += 1
        if attachment.name == layout.SCENARIO_ATTACHMENT:
            self._planned_steps = _planned_steps(attachment.data)
            self._holes = Holes(attachment.data)
        writer.add_attachment(
            create_time=attachment.create_time,
            log_time=attachment.log_time,
            name=attachment.name,
            media_type=attachment.media_type,
            data=attachment.data,
        )

    def _recovery(self) -> Recovery:
        scanner = self._scanner
        return Recovery(
            source=scanner.path,
            target=self._target,
            damage="it is still being written" if self._is_live else scanner.damage,
            cut_step=self._cut_step,
            messages=self._counts[Message],
            attachments=self._counts[Attachment],
            metadata=self._counts[Metadata],
            last_step=self._last_step,
            planned_steps=self._planned_steps,
            kept_bytes=scanner.intact_bytes,
            lost_bytes=scanner.size - scanner.intact_bytes,
            only_index_lost=scanner.has_end and self._cut_step is None,
            holes=self._holes.end(),
        )


def _planned_steps(data: bytes) -> int | None:
    """Return how many steps a resolved scenario asks for; None where it does not say."""
    with contextlib.suppress(StepbusError, UnicodeDecodeError, KeyError, TypeError, AttributeError):
        content = parse_yaml(layout.SCENARIO_ATTACHMENT, data.decode())
        return parse_duration(content["duration"]) // parse_duration(content["step"])
    return None
