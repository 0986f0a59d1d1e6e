"""The content of a report of one run."""

import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Batch, Port, Recording, layout
from stepbus_orchestrator.recording.timing import StepTiming
from stepbus_orchestrator.run.reports import Lateness, in_units
from stepbus_orchestrator.run.result import result_beside
from stepbus_schemas import Image, StepbusError
from stepbus_tools.columns import readable
from stepbus_tools.report.charts import Chart, Mark, field_chart, joint_charts
from stepbus_tools.report.curves import (
    ContactCurves,
    JointCurves,
    PortCurves,
    PortReader,
    read_ports,
)
from stepbus_tools.report.picture import draw_report, is_pictured
from stepbus_tools.report.summary import read_joints, scenario_name
from stepbus_tools.theme import line_style
from stepbus_tools.viewing.exports import check_readable
from stepbus_tools.viewing.exports.scene_file import scene_at_end
from stepbus_tools.viewing.history import History, read_timeline
from stepbus_tools.wiring import recorded_wiring

_decode = msgspec.msgpack.Decoder(StepTiming).decode
_BINS_PER_E = 2000
_BINS = 50_000


class StepTimes:
    """How long the steps of one participant took, in memory that does not grow [µs].

    sums: of wait and compute. longest: computing time of a step.
    """

    def __init__(self) -> None:
        self._steps = 0
        self.sums = np.zeros(2)
        self.longest = 0.0
        # Of ln(1 + µs): a twentieth of a percent each.
        self._bins = np.zeros(_BINS, dtype=int)

    def take(self, times: NDArray[np.float64]) -> None:
        """Take some steps, shape (T, 2): wait and compute [µs]."""
        bins = (np.log1p(times[:, 1].clip(0.0)) * _BINS_PER_E).astype(int).clip(max=_BINS - 1)
        np.add.at(self._bins, bins, 1)
        self._steps += len(times)
        self.sums += times.sum(axis=0)
        self.longest = max(self.longest, float(times[:, 1].max(initial=0.0)))

    @property
    def means(self) -> tuple[float, float]:
        """Return the means of wait and compute [µs]."""
        wait, compute = self.sums / self._steps
        return float(wait), float(compute)

    @property
    def figures(self) -> tuple[float, float, float, float]:
        """Return mean, 99th percentile (to 0.05 %) and longest compute, and mean wait."""
        place = np.searchsorted(self._bins.cumsum(), 0.99 * self._steps)
        wait, compute = self.means
        p99 = min(float(np.expm1((place + 0.5) / _BINS_PER_E)), self.longest)
        return compute, p99, self.longest, wait


def read_step_times(folder: Path) -> Mapping[str, StepTimes]:
    """Return the times of all steps; none without a timing.mcap that can be read."""
    times: defaultdict[str, StepTimes] = defaultdict(StepTimes)
    try:
        with Recording(folder / layout.TIMING_FILE) as recording:
            port = recording.ports.get("steps")
            for entry in port.entries() if port else ():
                timing = _decode(entry.data)
                if timing.rows:
                    part = np.array(timing.rows, dtype=float).reshape(-1, 3)[:, 1:]
                    times[timing.participant].take(part * 1e-3)
    except (RecordingFailed, msgspec.MsgspecError):
        pass
    return times


def times_html(times: Mapping[str, StepTimes]) -> str:
    """Return a table of participants, the slowest first."""
    most = max(sum(one.means) for one in times.values()) or 1.0
    rows = []
    for name, one in sorted(times.items(), key=lambda row: -row[1].sums[1]):
        wait, compute = one.means
        shares = "".join(
            f'<i class={style} style="width:{100 * time / most:.1f}%"></i>'
            for style, time in (("f0", compute), ("wait", wait))
        )
        cells = "".join(f"<td>{in_units(value)}</td>" for value in one.figures)
        rows.append(f"<tr><td>{escape(name)}</td>{cells}<td class=bar>{shares}</td></tr>")
    return (
        "<div class=scroll tabindex=0><table><tr><th>participant</th><th>compute</th><th>p99</th>"
        "<th>longest</th><th>wait</th><th class=bar>mean step: compute, wait</th></tr>"
        f"{''.join(rows)}</table></div>"
    )


def lateness_html(late: Lateness) -> str:
    """Return how late the steps of a run in real time were."""
    return (
        f"<h3>Lateness of steps</h3><p>p50 {in_units(late.p50_us)}, p99 {in_units(late.p99_us)}, "
        f"max {in_units(late.max_us)}, at {late.factor:g} × real time</p>"
    )


_JOINTS = ("JointCommand/1", "JointReference/1", "JointState/1")
_SHAPELESS = ("Detections/1", "Goal/1", "LaserScan/1", "Plan/1", "PlanRequest/1", "PointCloud/1")
"""Types whose numbers make no curve."""
_TITLES = {"BaseState/1": "Base", "Contacts/1": "Contacts", "GripperState/1": "Gripper"}
_QUIET = ("ControllerStatus/1", "Transforms/1", "Poses/1", "BaseCommand/1")
"""Types that ship whose charts are folded."""
_MOST_LINES = 12
_MOST_JOINTS = 14
_FEW_JOINTS, _SMALL = 6, 0.01
"""Of more joints, those are folded whose error is so small beside the largest."""
_STILLS = 4
_FEW_EVENTS = 30


@dataclass(frozen=True, kw_only=True)
class Group:
    """Charts under one title. is_open: whether they are seen at once. color: of a joint."""

    title: str
    charts: Sequence[Chart]
    is_open: bool = True
    color: int | None = None


class Stills(PortReader):
    """Some pictures of a camera, from its first to its last: time [s] and image."""

    def __init__(self, port: Port) -> None:
        super().__init__(port)
        self.images: list[tuple[float, Image]] = []
        last = max(1, port.last_step)
        self._wanted = [last * i // (_STILLS - 1) for i in range(_STILLS)]

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        if self._wanted and batch.steps[-1] >= self._wanted[0]:
            for step, t, message in zip(batch.steps, batch.t, batch.messages(), strict=True):
                if self._wanted and step >= self._wanted[0] and isinstance(message, Image):
                    self.images.append((float(t), message))
                    self._wanted = [wanted for wanted in self._wanted if wanted > step]


class RunPage:
    """One run, read piece by piece.

    label: among several runs; empty for one alone. lines: of its summary. events_left: how many are
    not shown. problems: what cannot be shown, a sentence each. scene: at its end, where it has one.
    groups: of charts. wiring: as HTML.

    Raises RecordingFailed when it is no recording, or has no messages of types that it knows.
    """

    def __init__(self, path: Path) -> None:
        self.label = ""
        self.joints = JointCurves()
        self.lines: Sequence[str] = ()
        self.problems: list[str] = []
        with Recording(path) as recording:
            check_readable(recording)
            self.recording, self.path = recording, recording.path
            self.last_step = recording.last_step
            self.result = result_beside(recording)
            self.name = self.result.scenario if self.result else scenario_name(recording)
            if recording.cut_short:
                end = f"it is shown up to step {self.last_step}"
                self.problems.append(f"the recording {recording.cut_short}; {end}")
            try:
                self.joints, self.lines = read_joints(recording)
            except StepbusError as exc:
                self.problems.append(f"joints: {exc}")
            readers, others = _readers(recording)
            end_s = max(self.joints.end_s, read_ports(recording, readers))
            # Of a failed run, others were some steps ahead of what has failed.
            self.end_s = min(end_s, History(recording).end_ns * 1e-9)
            self.problems += [
                *others,
                *(f"{r.port.topic}: {r.problem}" for r in readers if r.problem),
            ]
            self.ports = [reader for reader in readers if isinstance(reader, PortCurves)]
            self.cameras = [reader for reader in readers if isinstance(reader, Stills)]
            events, self.events_left = read_timeline(recording, self.result)
            self.events = [replace(one, text=self.local(one.text)) for one in events]
            self.times = read_step_times(self.path.parent) if self.result else {}
            self.scene = scene_at_end(recording)
            self.wiring = recorded_wiring(recording)
        self.groups = list(_groups(self))

    @property
    def marks(self) -> list[Mark]:
        """Return the events that all charts mark: all events if they are few, else the serious."""
        is_short = len(self.events) <= _FEW_EVENTS
        return [one for one in self.events if is_short or one.level != "info"]

    def draw(self) -> Iterator[str]:
        """Write report.png beside the recording; yield the line of the summary about it."""
        yield from draw_report(self.recording, self.joints, self.ports, self.marks, self.result)

    def local(self, text: str) -> str:
        """Return a text without the folder of the run: nobody else has this machine's folders."""
        return text.replace(f"{self.path.resolve().parent}/", "")


def _readers(recording: Recording) -> tuple[list[PortReader], list[str]]:
    """Return readers of all ports except joints, and why some ports are not shown."""
    tables, lost = readable(recording)
    readers: list[PortReader] = []
    for table in tables:
        if table.port.type == "Contacts/1":
            readers.append(ContactCurves(table, _MOST_LINES))
        elif table.port.type == "Image/1":
            readers.append(Stills(table.port))
        elif table.port.type not in (*_JOINTS, *_SHAPELESS):
            widest = sys.maxsize if is_pictured(table.port) else _MOST_LINES
            readers.append(PortCurves(table, _MOST_LINES, widest=widest))
    return readers, list(lost.values())


def _groups(run: RunPage) -> Iterator[Group]:
    """Yield all charts of a run: those of all joints, of each joint, the worst first, of ports."""
    joints = run.joints.measured
    charts = {joint: [c for c in joint_charts(run.joints, joint) if c.lines] for joint in joints}
    errors = {joint: c for joint in joints for c in charts[joint] if c.title == "error"}
    known = [joint for joint in joints[:_MOST_JOINTS] if joint in errors]
    named = {joint: replace(errors[joint].lines[0], label=joint) for joint in known}
    overview = [
        Chart("error", unit, lines)
        for unit in ("rad", "m")
        if (lines := [named[joint] for joint in known if errors[joint].unit == unit])
    ]
    if len(joints) > 1 and overview:
        more = len(joints) - _MOST_JOINTS
        title = f"Error of all joints{f' ({more} more below)' if more > 0 else ''}"
        yield Group(title=title, charts=overview)
    worst = sorted(joints, key=lambda one: -errors[one].largest if one in errors else 1.0)
    largest = max((chart.largest for chart in errors.values()), default=0.0)
    for joint in worst:
        color = line_style(joints.index(joint)).color
        is_small = joint in errors and errors[joint].largest < _SMALL * largest
        is_open = len(joints) <= _FEW_JOINTS or not is_small
        yield Group(title=joint, charts=charts[joint], is_open=is_open, color=color)
    for port in run.ports:
        fields = [f for f in port.fields.values() if len(f.labels) <= _MOST_LINES]
        shown = [chart for field in fields if (chart := field_chart(field, _MOST_LINES)).lines]
        if shown:
            kind, name = port.port.type, port.name
            title = f"{_TITLES[kind]}: {name}" if kind in _TITLES else f"{name} ({kind})"
            is_open = kind not in _QUIET and any(chart.varies for chart in shown)
            yield Group(title=title, is_open=is_open, charts=shown)
