"""Makes a complete recording of one that is cut off or corrupt."""

import contextlib
import dataclasses
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mcap import records as mcap

from stepbus_orchestrator.errors import OutputExists, RecordingFailed, argument
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import Holes
from stepbus_orchestrator.recording.index import Scanner
from stepbus_orchestrator.recording.mcap_file import McapFile, whole_file
from stepbus_orchestrator.recording.records import RecordFile
from stepbus_orchestrator.recording.reserved_file import is_locked
from stepbus_participant import Disk, irregular, parse_duration
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
    if irregular(target):
        raise RecordingFailed(f"{target} is not a regular file; choose another name")
    if target.exists() and not in_place:
        raise OutputExists(
            f"{target} already exists; choose another name with {argument('--out', 'target')}"
        )
    file = RecordFile(source)
    with contextlib.closing(file):
        is_live = is_locked(file.descriptor)
        if in_place and is_live:
            raise RecordingFailed(
                f"{source} is still being written; wait until its run has ended, or write what it "
                f"has so far to another file with {argument('--out', 'target')}"
            )
        scanner = Scanner(file)
        records = scanner.records()
        header = next(records, None)
        if not isinstance(header, mcap.Header):
            reached("a recording holds nothing")
            raise RecordingFailed(
                f"{source} has {scanner.size} bytes and no complete record: there is nothing to "
                "recover"
            )
        library = layout.LIBRARY if scanner.index.is_ours else header.library
        with whole_file(target, disk, library=library, profile=header.profile) as copied:
            copy = _Copy(scanner, copied)
            copy.run(records)
    index = scanner.index
    return Recovery(
        source=source,
        target=target,
        damage="it is still being written" if is_live else index.damage,
        cut_step=copy.cut_step,
        messages=copy.counts[mcap.Message],
        attachments=copy.counts[mcap.Attachment],
        metadata=copy.counts[mcap.Metadata],
        last_step=copy.last_step,
        planned_steps=_planned_steps(index.scenario),
        kept_bytes=scanner.intact_bytes,
        lost_bytes=scanner.size - scanner.intact_bytes,
        only_index_lost=scanner.has_end and copy.cut_step is None,
        holes=copy.holes.found,
    )


class _Copy:
    """Writes the records of one file into another, with numbers of its own for channels."""

    def __init__(self, scanner: Scanner, file: McapFile) -> None:
        self.counts: Counter[type] = Counter()
        self.last_step = -1
        self.cut_step: int | None = None
        self._index = scanner.index
        self._file = file
        self._schemas = {0: 0}
        self._channels: dict[int, int] = {}

    @cached_property
    def holes(self) -> Holes:
        """Return what finds holes; the scenario precedes all messages."""
        return Holes(self._index.scenario)

    def run(self, records: Iterator[mcap.McapRecord]) -> None:
        """Write all complete records, and close the file."""
        step, newest = -1, list[mcap.McapRecord]()
        last: mcap.Metadata | None = None
        for record in records:
            # A message is copied once it is known that nothing of its step is missing.
            if isinstance(record, mcap.Message) and self._index.is_ours:
                if record.sequence != step:
                    self._copy_all(newest)
                    newest.clear()
                step = record.sequence
            if isinstance(record, mcap.Metadata) and record.name == layout.INCOMPLETE_METADATA:
                self.counts[mcap.Metadata] += 1
                last = record
            elif step >= 0:
                newest.append(record)
            else:
                self._copy(record)
        if newest and not self._index.ends_a_step:
            reached("a recording ends within a step")
            self.cut_step = step
            newest = [one for one in newest if not isinstance(one, mcap.Message)]
        self._copy_all(newest)
        self._file.close(last)

    def _copy_all(self, records: Iterable[mcap.McapRecord]) -> None:
        for record in records:
            self._copy(record)

    def _copy(self, record: mcap.McapRecord) -> None:
        match record:
            case mcap.Message():
                topic = self._index.channels[record.channel_id].topic
                self.holes.add(topic, record.sequence, record.data)
                self.last_step = max(self.last_step, record.sequence)
                message = self._channels[record.channel_id], record.data
                self._file.add_all([message], record.log_time, record.sequence)
            case mcap.Channel() if record.id not in self._channels:
                schema = self._schemas.get(record.schema_id, 0)
                copied = dataclasses.replace(record, schema_id=schema)
                self._channels[record.id] = self._file.register(copied)
            case mcap.Schema() if record.id not in self._schemas:
                self._schemas[record.id] = self._file.register(record)
            case mcap.Attachment() | mcap.Metadata():
                self._file.add_record(record)
        self.counts[type(record)] += 1


def _planned_steps(scenario: Mapping[str, Any]) -> int | None:
    """Return how many steps a resolved scenario asks for; None where it does not say."""
    with contextlib.suppress(StepbusError, KeyError, TypeError, AttributeError):
        return parse_duration(scenario["duration"]) // parse_duration(scenario["step"])
    return None
