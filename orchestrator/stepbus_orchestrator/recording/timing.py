"""Writes timing.mcap: when everything happened by the wall clock, which run.mcap leaves out."""

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording.mcap_file import McapFile
from stepbus_participant import Clock, Disk

# In synchronous mode a record for each step and trigger was a quarter of the orchestrator's work.
_ROWS = 256

_encode = msgspec.msgpack.Encoder().encode


class TimingEvent(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened once: a spawn, a join, the start, an injected fault, the end."""

    event: str
    participant: str
    text: str


class StepTiming(msgspec.Struct, frozen=True, kw_only=True):
    """How long a participant waited and computed in its steps."""

    participant: str
    rows: list[tuple[int, int, int]]
    """(step, waited [ns], computed [ns])."""
    arrivals: list[tuple[int, int]]
    """When log batches arrived: (newest step, time since the epoch [ns])."""


class TriggerTiming(msgspec.Struct, frozen=True, kw_only=True):
    """When triggers were sent."""

    rows: list[tuple[int, int]]
    """(step limit, time since the epoch [ns])."""


_TOPICS: Mapping[type[msgspec.Struct], str] = {
    TimingEvent: "events",
    StepTiming: "steps",
    TriggerTiming: "triggers",
}


class TimingRecorder:
    """Appends to timing.mcap; its log times are nanoseconds since the epoch.

    It decides nothing: when the disk is full it stops writing, and leaves it to the recording
    itself to end the run. path: None: it writes nothing. clock, disk: of the run.
    """

    def __init__(self, path: Path | None, clock: Clock, disk: Disk = os) -> None:
        self._clock = clock
        self._file = None if path is None else McapFile(path, disk)
        self._channels: dict[type[msgspec.Struct], int] = {}
        if self._file is not None:
            for cls, topic in _TOPICS.items():
                (_,), schemas = msgspec.json.schema_components([cls])
                types = {f"{name}/1": schema for name, schema in schemas.items()}
                name = f"{cls.__name__}/1"
                self._channels[cls] = self._file.add_channel(topic, name, {}, types.__getitem__)
        self._sequence = 0
        self._steps: dict[str, StepTiming] = {}
        self._triggers: list[tuple[int, int]] = []

    def event(self, event: str, participant: str = "", text: str = "") -> None:
        """Record that something happened now."""
        self._add(TimingEvent(event=event, participant=participant, text=text))

    def steps(self, participant: str, rows: list[tuple[int, int, int]]) -> None:
        """Record that a log batch arrived now, and how long its steps took."""
        held = self._steps.get(participant)
        if held is None:
            held = StepTiming(participant=participant, rows=[], arrivals=[])
            self._steps[participant] = held
        held.rows.extend(rows)
        held.arrivals.append((rows[-1][0], self._clock.time_ns()))
        if len(held.rows) >= _ROWS:
            self._add(self._steps.pop(participant))

    def trigger(self, step_limit: int) -> None:
        """Record that a trigger was sent now."""
        self._triggers.append((step_limit, self._clock.time_ns()))
        if len(self._triggers) >= _ROWS:
            self._add(TriggerTiming(rows=self._triggers))
            self._triggers = []

    def _add(self, record: msgspec.Struct) -> None:
        self._sequence += 1
        if self._file is not None:
            channel, data = self._channels[type(record)], _encode(record)
            with contextlib.suppress(RecordingFailed):
                self._file.add(channel, self._clock.time_ns(), data, self._sequence)

    def close(self) -> None:
        """Write the rest and complete the file, as far as the disk allows."""
        for held in self._steps.values():
            self._add(held)
        if self._triggers:
            self._add(TriggerTiming(rows=self._triggers))
        self._steps, self._triggers = {}, []
        if self._file is not None:
            with contextlib.suppress(RecordingFailed):
                self._file.close()
