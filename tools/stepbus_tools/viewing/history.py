"""A recording at any time, and what happened in it: read when it is asked for."""

import contextlib
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from stepbus_orchestrator.recording import Port, Recording, layout
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.scenario.fault_texts import read_fault
from stepbus_schemas import (
    CallRecord,
    Decoder,
    Event,
    GoalStatus,
    MessageError,
    StepbusError,
    WiringError,
)
from stepbus_tools.columns import dotted
from stepbus_tools.report.charts import Mark
from stepbus_tools.viewing.scene.scene import Latest, Messages

EVENT_TYPES = ("Event/1", "GoalStatus/1", layout.CALLS_TYPE)
_MOST = 400
_MOST_OF_ONE = 4 * _MOST
"""A port that talks all the time drowns no other."""
_SERIOUS = ("error", "fault", "warning", "failure")


class History:
    """A recording at any time, up to its last whole step.

    end_ns: of that step [ns]. last_step: its number; −1 without messages. step_ns: length of a
    step [ns], as the recording has it.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        ends = [row for port in recording.ports.values() if (row := port.last) is not None]
        newest = max((row.step for row in ends), default=-1)
        t_ns = max((row.t_ns for row in ends), default=0)
        self.step_ns = t_ns // newest if newest > 0 else 1
        self.last_step = min(newest, recording.last_whole_step)
        self.end_ns = t_ns if self.last_step == newest else self.last_step * self.step_ns

    def times(self, count: int) -> list[int]:
        """Return evenly spaced times from its start to its end [ns], one more than `count`."""
        return [self.end_ns * number // count for number in range(count + 1)]

    def at(self, topics: Iterable[str], t_ns: int) -> Messages:
        """Return the newest message of each port at a time [ns].

        A port whose message cannot be read is left out: what else there is, is shown.
        """
        latest: dict[str, Latest] = {}
        for topic in topics:
            port = self.recording.ports.get(topic)
            with contextlib.suppress(MessageError, WiringError):
                if port is not None and (row := port.latest(t_ns)) is not None:
                    latest[topic] = Latest(*row)
        return latest


def read_timeline(recording: Recording, result: Result | None) -> tuple[list[Mark], int]:
    """Return the events in order of time, the serious first to be kept; and how many are left."""
    marks = [*_failure(result), *_faults(recording, result)]
    for port in recording.ports.values():
        if port.type in EVENT_TYPES:
            rows = (mark_of(dotted(port), t_ns * 1e-9, one) for t_ns, one in timed_messages(port))
            marks += islice(filter(None, rows), _MOST_OF_ONE)
    kept = sorted(marks, key=lambda one: one.level not in _SERIOUS)[:_MOST]
    return sorted(kept, key=lambda one: one.t), len(marks) - len(kept)


def timed_messages(port: Port) -> Iterator[tuple[int, Any]]:
    """Yield time [ns] and message, up to the first that cannot be read."""
    is_call = port.type == layout.CALLS_TYPE
    decode = Decoder(CallRecord if is_call else port.message_class)
    with contextlib.suppress(StepbusError):
        for entry in port.entries():
            yield entry.t_ns, decode(entry.data)


def mark_of(source: str, t: float, message: object) -> Mark | None:
    """Return the mark of a message at a time [s]; None unless it is an event, a call or a goal."""
    match message:
        case CallRecord():
            text = f"{message.method}({', '.join(map(repr, message.args))})"
            text += f": {message.error}" if message.error else ""
            return Mark(t=t, level="call", source=message.participant, text=text)
        case Event():
            return Mark(t=t, level=message.level, source=source, text=message.text)
        case GoalStatus() if message.state not in ("accepted", "running"):
            level = "warning" if message.state == "failed" else "goal"
            text = f"goal {message.id} {message.state}. {message.text}".rstrip()
            return Mark(t=t, level=level, source=source, text=text)
    return None


def _faults(recording: Recording, result: Result | None) -> Iterator[Mark]:
    """Yield a mark for each injected fault."""
    planned = recording.metadata.get(layout.FAULTS_METADATA, {}).values()
    step_ns = result.step_ns if result else History(recording).step_ns
    for text in dict.fromkeys([*planned, *(result.faults if result else ())]):
        with contextlib.suppress(StepbusError):
            t_ns = read_fault(text).step * step_ns
            yield Mark(t=t_ns * 1e-9, level="fault", source="injected", text=text)


def _failure(result: Result | None) -> Iterator[Mark]:
    if result is not None and result.exit_code and result.at_step >= 0:
        t_ns = result.at_step * result.step_ns
        who = result.participant or "orchestrator"
        yield Mark(t=t_ns * 1e-9, level="failure", source=who, text=result.reason)


def stop_of(call: CallRecord, t_s: float) -> str | None:
    """Return who a call has stopped a robot for; empty: it has released it; None: another call."""
    if call.method != "emergency_stop" or call.error:
        return None
    active, by = (*call.args, "", "")[:2]
    return f"by {by or 'a call'}, since t = {t_s:.2f} s" if active else ""
