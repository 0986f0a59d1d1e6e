"""Makes a complete recording of one that is cut off or corrupt."""

import contextlib
import dataclasses
import io
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mcap import records as mcap

from stepbus_orchestrator.errors import OutputExists, RecordingFailed, argument
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import Holes
from stepbus_orchestrator.recording.message_writer import MessageWriter
from stepbus_orchestrator.recording.records import RecordFile
from stepbus_orchestrator.recording.reserved_file import is_locked
from stepbus_orchestrator.recording.scanner import Scanner
from stepbus_participant import Disk, NewFile, irregular, parse_duration
from stepbus_schemas import StepbusError, reached


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """Result of a recovery.

    damage: damage of the source; empty if none. cut_step: incomplete last step, which is skipped;
    None if the last step is complete. messages, attachments, metadata: how many records were kept.
    last_step: the newest step with a message; −1 without any. planned_steps: number of steps in the
    scenario, if known. kept_bytes, lost_bytes: bytes of the source; the lost ones include the
    index, which is rebuilt. only_index_lost: whether all messages were kept. holes: gaps between
    them.
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
        """Return how many steps of the scenario are missing; None if unknown."""
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
        raise RecordingFailed(
            f"{target} is {kind}: it cannot be replaced by a file; choose another name"
        )
    if target.exists() and not in_place:
        raise OutputExists(
            f"{target} already exists; choose another name with {argument('--out', 'target')}"
        )
    file = RecordFile(source)
    is_live = is_locked(file.descriptor)
    if in_place and is_live:
        raise RecordingFailed(
            f"{source} is still being written; wait until its run has ended, or write what it has "
            f"so far to another file with {argument('--out', 'target')}"
        )
    part = target.with_name(f".{target.name}.part")
    copy = _Copy(file)
    try:
        try:
            copy.write(part, disk)
            disk.replace(part, target)
        finally:
            file.close()
            with contextlib.suppress(FileNotFoundError):
                disk.unlink(part)
    except OSError as exc:
        if isinstance(exc, RecordingFailed):
            raise
        raise RecordingFailed(
            f"{target} cannot be written: {exc.strerror or exc}; choose another file with "
            f"{argument('--out', 'target')}"
        ) from exc
    return copy.recovery(source, target, is_live=is_live)


class _Copy:
    """Writes the records of one file into another, with numbers of its own for channels."""

    def __init__(self, file: RecordFile) -> None:
        self._scanner = Scanner(file)
        self._schemas = {0: 0}
        self._channels: dict[int, int] = {}
        self._counts: Counter[type] = Counter()
        self._last_step = -1
        self._newest_step = -1
        self._newest: list[mcap.McapRecord] = []
        """The messages of the newest step, and whatever stands behind the first of them."""
        self._cut_step: int | None = None
        self._last: mcap.Metadata | None = None

    @cached_property
    def _holes(self) -> Holes:
        # The scenario precedes all messages.
        return Holes(self._scanner.index.scenario)

    def write(self, part: Path, disk: Disk) -> None:
        """Write all complete records to `part`; raises OSError when that cannot be written."""
        records, index = self._scanner.records(), self._scanner.index
        header = next(records, None)
        if not isinstance(header, mcap.Header):
            reached("a recording holds nothing")
            raise RecordingFailed(
                f"{self._scanner.file.path} has {self._scanner.size} bytes and no complete record: "
                "there is nothing to recover"
            )
        library = layout.LIBRARY if index.is_ours else header.library
        # It may replace the only copy there is: `NewFile` brings it to the medium.
        with io.BufferedWriter(NewFile(part, disk)) as file:
            # As the recorder does, so that an undamaged recording comes out byte for byte.
            writer = MessageWriter(file, profile=header.profile, library=library)
            for record in records:
                # A message is copied once it is known that nothing of its step is missing.
                if isinstance(record, mcap.Message) and index.is_ours:
                    if record.sequence != self._newest_step:
                        self._copy_newest(writer)
                    self._newest_step = record.sequence
                    self._newest.append(record)
                elif self._newest:
                    self._newest.append(record)
                else:
                    self._copy(writer, record)
            if self._newest and not index.ends_a_step:
                reached("a recording ends within a step")
                self._cut_step = self._newest_step
                self._newest = [one for one in self._newest if not isinstance(one, mcap.Message)]
            self._copy_newest(writer)
            writer.finish(self._last)

    def _copy_newest(self, writer: MessageWriter) -> None:
        for record in self._newest:
            self._copy(writer, record)
        self._newest.clear()

    def _copy(self, writer: MessageWriter, record: mcap.McapRecord) -> None:
        match record:
            case mcap.Message():
                self._copy_message(writer, record)
            case mcap.Channel() if record.id not in self._channels:
                schema = self._schemas.get(record.schema_id, 0)
                copied = dataclasses.replace(record, schema_id=schema)
                self._channels[record.id] = writer.register(copied)
            case mcap.Schema() if record.id not in self._schemas:
                self._schemas[record.id] = writer.register(record)
            case mcap.Metadata(name=layout.INCOMPLETE_METADATA):
                self._counts[mcap.Metadata] += 1
                self._last = record
            case mcap.Attachment() | mcap.Metadata():
                self._counts[type(record)] += 1
                writer.add(record)

    def _copy_message(self, writer: MessageWriter, message: mcap.Message) -> None:
        self._counts[mcap.Message] += 1
        self._last_step = max(self._last_step, message.sequence)
        topic = self._scanner.index.channels[message.channel_id].topic
        self._holes.add(topic, message.sequence, message.data)
        writer.add_messages(
            [(self._channels[message.channel_id], message.data)],
            message.log_time,
            message.publish_time,
            message.sequence,
        )

    def recovery(self, source: Path, target: Path, *, is_live: bool) -> Recovery:
        """Return what was saved and lost, once all is written."""
        scanner = self._scanner
        return Recovery(
            source=source,
            target=target,
            damage="it is still being written" if is_live else scanner.index.damage,
            cut_step=self._cut_step,
            messages=self._counts[mcap.Message],
            attachments=self._counts[mcap.Attachment],
            metadata=self._counts[mcap.Metadata],
            last_step=self._last_step,
            planned_steps=_planned_steps(scanner.index.scenario),
            kept_bytes=scanner.intact_bytes,
            lost_bytes=scanner.size - scanner.intact_bytes,
            only_index_lost=scanner.has_end and self._cut_step is None,
            holes=self._holes.end(),
        )


def _planned_steps(scenario: Mapping[str, Any]) -> int | None:
    """Return how many steps a resolved scenario asks for; None where it does not say."""
    with contextlib.suppress(StepbusError, KeyError, TypeError, AttributeError):
        return parse_duration(scenario["duration"]) // parse_duration(scenario["step"])
    return None
