"""What happened in a run, and when: events, faults, calls, and how long steps took."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording, layout, recorded_decoder
from stepbus_orchestrator.recording.timing import StepTiming
from stepbus_orchestrator.run.result import Result
from stepbus_schemas import CallRecord, Event, GoalStatus, StepbusError

EDGES_US: NDArray[np.float64] = np.logspace(0, 6, 37)
"""Of the bins of the histogram [µs]; the last one has the rest too."""

_decode = msgspec.msgpack.Decoder(StepTiming).decode


@dataclass
class StepTimes:
    """The times of one participant's steps. compute, wait: sums [ns]. counts: of each bin."""

    steps: int = 0
    compute: int = 0
    wait: int = 0
    longest: int = 0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(EDGES_US), np.int64))

    def take(self, timing: StepTiming) -> None:
        """Take the next steps."""
        rows = np.array(timing.rows, dtype=np.int64).reshape(-1, 3)
        self.steps += len(rows)
        self.wait += int(rows[:, 1].sum())
        self.compute += int(rows[:, 2].sum())
        self.longest = max(self.longest, int(rows[:, 2].max(initial=0)))
        at = np.searchsorted(EDGES_US, rows[:, 2] * 1e-3)
        self.counts += np.bincount(np.minimum(at, len(EDGES_US) - 1), minlength=len(EDGES_US))

    def quantile_us(self, share: float) -> float:
        """Return an upper bound of a share of the compute times [µs]."""
        at = int(np.searchsorted(np.cumsum(self.counts), share * self.steps))
        return float(EDGES_US[min(at, len(EDGES_US) - 1)])


def step_times(folder: Path) -> Mapping[str, StepTimes]:
    """Return participant → its step times; none without a timing.mcap that can be read."""
    times: dict[str, StepTimes] = {}
    try:
        with Recording(folder / layout.TIMING_FILE) as recording:
            port = recording.ports.get("steps")
            for entry in port.entries() if port else ():
                timing = _decode(entry.data)
                times.setdefault(timing.participant, StepTimes()).take(timing)
    except (RecordingFailed, msgspec.MsgspecError):
        return times
    return times


_MOST = 400
_FAULT = re.compile(r"\bat (\d+)\b")
_SERIOUS = ("error", "fault", "warning", "failure")
_call = recorded_decoder(CallRecord)


@dataclass(frozen=True, kw_only=True)
class Happening:
    """Something that happened. t: [s]. level: info, warning, error, goal, call, fault, failure."""

    t: float
    level: str
    source: str
    text: str

    def row(self) -> Mapping[str, object]:
        """Return it for the script of the page."""
        return asdict(self)


def happenings(recording: Recording, result: Result | None) -> tuple[list[Happening], int]:
    """Return what happened in order of time, the serious first to be kept; and how much is left."""
    events = [*_failure(result), *_faults(recording, result)]
    for port in recording.ports.values():
        if port.type in ("Event/1", "GoalStatus/1", layout.CALLS_TYPE):
            try:
                events += _bounded(_of(port))
            except (StepbusError, msgspec.MsgspecError):
                continue
    kept = sorted(events, key=lambda one: one.level not in _SERIOUS)[:_MOST]
    return sorted(kept, key=lambda one: one.t), len(events) - len(kept)


def _bounded(rows: Iterable[Happening]) -> list[Happening]:
    """Return the first rows of a port; one that talks all the time drowns nobody else."""
    return [row for _, row in zip(range(4 * _MOST), rows, strict=False)]


def _of(port: Port) -> Iterator[Happening]:
    source = f"{port.participant}.{port.name}"
    if port.type == layout.CALLS_TYPE:
        for entry in port.entries():
            call = _call(entry.data)
            text = f"{call.method}({', '.join(map(repr, call.args))})"
            answer = f": {call.error}" if call.error else ""
            yield Happening(
                t=entry.t_ns * 1e-9, level="call", source=call.participant, text=text + answer
            )
        return
    for (_, message), t in zip(port.messages(), port.t, strict=False):
        if isinstance(message, Event):
            yield Happening(t=float(t), level=message.level, source=source, text=message.text)
        elif isinstance(message, GoalStatus) and message.state not in ("accepted", "running"):
            text = " ".join(filter(None, (f"goal {message.id} {message.state}.", message.text)))
            level = "warning" if message.state == "failed" else "goal"
            yield Happening(t=float(t), level=level, source=source, text=text)


def _faults(recording: Recording, result: Result | None) -> Iterator[Happening]:
    step_s = _step_s(recording, result)
    texts = dict.fromkeys([*recording.metadata.get(layout.FAULTS_METADATA, {}).values()])
    texts |= dict.fromkeys(result.faults if result else ())
    for text in texts:
        at = _FAULT.search(text)
        t = int(at[1]) * step_s if at else 0.0
        yield Happening(t=t, level="fault", source="injected", text=text)


def _failure(result: Result | None) -> Iterator[Happening]:
    if result is not None and result.exit_code and result.at_step >= 0:
        t = result.at_step * result.step_ns * 1e-9
        who = result.participant or "orchestrator"
        yield Happening(t=t, level="failure", source=who, text=result.reason)


def _step_s(recording: Recording, result: Result | None) -> float:
    if result is not None:
        return result.step_ns * 1e-9
    for port in recording.ports.values():
        for entry in port.entries():
            if entry.step:
                return entry.t_ns * 1e-9 / entry.step
    return 0.0
