"""Makes a complete recording of one that is cut off or corrupt."""

import contextlib
import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import OutputExists, RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import Holes
from stepbus_orchestrator.recording.mcap_file import McapFile, whole_file
from stepbus_orchestrator.recording.source import Source
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
    """Write all complete records of a recording to a new one, its messages in the recorded order.

    source: an MCAP file, uncompressed or zstd; it is only read. target: appears when it is
    complete; may exist, or be the source, only with `in_place`. disk: writes it.

    Raises RecordingFailed when the source holds nothing to recover, OutputExists when the target
    exists already, RecordingFailed when it cannot be written, and in place of a recording that is
    being written.
    """
    if irregular(target):
        raise RecordingFailed(f"{target} is not a regular file; choose another name")
    if target.exists() and not in_place:
        raise OutputExists(f"{target} already exists; choose another name with --out")
    with contextlib.closing(Source(source, scans=True)) as opened:
        if in_place and opened.is_live:
            raise RecordingFailed(
                f"{source} is still being written; wait until its run has ended, or write what it "
                "has so far to another file with --out"
            )
        scanner, index = opened.scanner, opened.index
        if scanner is None or index.header is None:
            reached("a recording holds nothing")
            raise RecordingFailed(
                f"{source} has {source.stat().st_size} bytes and no complete record: there is "
                "nothing to recover"
            )
        if opened.cut_step is not None:
            reached("a recording ends within a step")
        library = layout.LIBRARY if index.is_ours else index.header.library
        with whole_file(target, disk, library=library, profile=index.header.profile) as file:
            count, last_step, holes = _copy(opened, file)
    return Recovery(
        source=source,
        target=target,
        damage="it is still being written" if opened.is_live else index.damage,
        cut_step=opened.cut_step,
        messages=count,
        attachments=len(index.attachments),
        metadata=len(index.metadata),
        last_step=last_step,
        planned_steps=planned_steps(index.scenario),
        kept_bytes=scanner.intact_bytes,
        lost_bytes=scanner.size - scanner.intact_bytes,
        only_index_lost=scanner.has_end and opened.cut_step is None,
        holes=holes,
    )


def _copy(source: Source, file: McapFile) -> tuple[int, int, Sequence[str]]:
    """Write all that a recording has, and close the file.

    Return the number of messages, the newest step, −1 without any, and the holes between them.
    """
    index = source.index
    for name, content in index.attachments.items():
        file.attach(name, content)
    for name, facts in index.metadata.items():
        if name != layout.INCOMPLETE_METADATA:
            file.add_metadata(name, facts)
    schemas, channels = {0: 0}, dict[int, int]()

    def register(number: int) -> None:
        channel = index.channels[number]
        schema = channel.schema_id
        if schema not in schemas and schema in index.schemas:
            schemas[schema] = file.register(index.schemas[schema])
        copied = dataclasses.replace(channel, schema_id=schemas.get(schema, 0))
        channels[number] = file.register(copied)

    for number, channel in index.channels.items():
        # A run registers it before the first call.
        if channel.topic != layout.CALLS_TOPIC:
            register(number)
    count, last_step, holes = 0, -1, Holes(index.scenario)
    for number, step, t_ns, data in source.rows():
        if number not in channels:
            register(number)
        file.add(channels[number], t_ns, data, step)
        holes.add(index.channels[number].topic, step, data)
        count, last_step = count + 1, max(last_step, step)
    file.close(index.metadata.get(layout.INCOMPLETE_METADATA))
    return count, last_step, holes.found


def planned_steps(scenario: Mapping[str, Any]) -> int | None:
    """Return how many steps a resolved scenario asks for; None where it does not say."""
    with contextlib.suppress(StepbusError, KeyError, TypeError, AttributeError):
        return parse_duration(scenario["duration"]) // parse_duration(scenario["step"])
    return None
