"""Charts of what is no joint, chosen by port type; numbers of any type of the user's own."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Batch, Port, Recording
from stepbus_schemas import Contacts, Image, Message, StepbusError
from stepbus_tools.report.curves import Curve
from stepbus_tools.viewing.exports import CLOCK, Column, Table, unreadable
from stepbus_tools.viewing.page.joint_curves import Arrays

_JOINTS = ("JointCommand/1", "JointReference/1", "JointState/1")
_SHAPELESS = ("Detections/1", "Goal/1", "LaserScan/1", "Plan/1", "PlanRequest/1", "PointCloud/1")
"""Types whose numbers make no curve."""
_TITLES = {
    "BaseState/1": "Base",
    "Contacts/1": "Contacts",
    "GripperState/1": "Gripper",
    "Image/1": "",
}
_MOST_LINES = 12
_STILLS = 4


class PortCurves:
    """The curves of one port; give it all its batches."""

    def __init__(self, port: Port, recording: Recording) -> None:
        self.port = port
        self._table = Table(port, recording.types)
        self._curves = {field.name: Curve() for field in self._table.fields}
        self._columns: dict[str, Sequence[Column]] = {
            field.name: field.columns
            for field in self._table.fields
            if field.columns[0].type in ("double", "int64", "bool")
            and len(field.columns) <= _MOST_LINES
        }
        self.problem = ""

    def take(self, batch: Batch) -> None:
        """Take the next piece; one that cannot be read ends the port, and is its problem."""
        if self.problem or not len(batch.steps) or not self._columns:
            return
        try:
            values = self._table.values(batch, self._columns)
        except (StepbusError, ValueError) as exc:
            self.problem = str(exc)
            return
        at = len(CLOCK)
        for name, columns in self._columns.items():
            rows = values[at : at + len(columns)]
            at += len(columns)
            self._curves[name].add(batch.t, np.array(rows, dtype=float).T)

    def group(self, arrays: Arrays) -> Mapping[str, Any]:
        """Return its charts."""
        title = _TITLES.get(self.port.type, "")
        name = f"{self.port.participant}.{self.port.name}"
        charts = list(self._charts(arrays))
        return {
            "title": f"{title}: {name}" if title else f"{name} ({self.port.type})",
            "open": bool(title) or self.port.type not in _SHIPPED_QUIET,
            "charts": charts,
        }

    def _charts(self, arrays: Arrays) -> Iterator[Mapping[str, Any]]:
        for name, columns in self._columns.items():
            curve = self._curves[name]
            lines = []
            for index, column in enumerate(columns):
                t, values = curve.line(index) if curve.count else (np.empty(0), np.empty(0))
                if arrays.has((t, values)):
                    label = column.name.partition(".")[2] or name
                    lines.append(arrays.line(label, t, values))
            if lines:
                key = f"{self.port.topic}/{name}"
                yield {"key": key, "title": name, "unit": columns[0].unit, "lines": lines}


_SHIPPED_QUIET = ("ControllerStatus/1", "Transforms/1", "Poses/1", "BaseCommand/1")


class ContactCurves:
    """How many contacts there are, and how hard."""

    problem = ""

    def __init__(self, port: Port) -> None:
        self.port = port
        self._curve = Curve()

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        rows = [
            (len(m.force), sum(m.force), max(m.force, default=0.0))
            for m in batch.messages()
            if isinstance(m, Contacts)
        ]
        if rows:
            self._curve.add(batch.t, np.array(rows, dtype=float))

    def group(self, arrays: Arrays) -> Mapping[str, Any]:
        """Return its charts."""

        def chart(title: str, unit: str, *rows: tuple[str, int]) -> Mapping[str, Any]:
            lines = [arrays.line(label, *self._curve.line(i)) for label, i in rows]
            key = f"{self.port.topic}/{title}"
            return {"key": key, "title": title, "unit": unit, "lines": lines}

        charts = [
            chart("pairs in contact", "", ("pairs", 0)),
            chart("normal force", "N", ("sum", 1), ("largest", 2)),
        ]
        title = f"Contacts: {self.port.participant}.{self.port.name}"
        return {"title": title, "open": True, "charts": charts if self._curve.count else []}


class Stills:
    """Some pictures of a camera, from its first to its last. last_step: of the port."""

    problem = ""

    def __init__(self, port: Port) -> None:
        self.port = port
        self.images: list[tuple[float, Image]] = []
        last = max(1, port.last_step)
        self._wanted = [last * i // (_STILLS - 1) for i in range(_STILLS)]

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        if self._wanted and len(batch.steps) and batch.steps[-1] >= self._wanted[0]:
            for step, t, message in zip(batch.steps, batch.t, batch.messages(), strict=True):
                self._see(int(step), float(t), message)

    def _see(self, step: int, t: float, message: Message) -> None:
        if self._wanted and step >= self._wanted[0] and isinstance(message, Image):
            self.images.append((t, message))
            self._wanted = [wanted for wanted in self._wanted if wanted > step]


class BasePath:
    """Where a base was, from above."""

    problem = ""

    def __init__(self, port: Port) -> None:
        self.port = port
        self._curve = Curve(together=True)

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        xy = batch.arrays("x", "y")
        if xy["x"] is not None and xy["y"] is not None:
            self._curve.add(batch.t, np.column_stack((xy["x"], xy["y"])))

    def points(self) -> Array:
        """Return x and y, shape (p, 2), [m]."""
        if not self._curve.count:
            return np.empty((0, 2))
        return np.column_stack((self._curve.line(0)[1], self._curve.line(1)[1]))


Taker = PortCurves | ContactCurves | Stills | BasePath


def takers(recording: Recording) -> tuple[list[Taker], list[str]]:
    """Return who takes the batches of which port, and why some ports are not shown."""
    rows: list[Taker] = []
    problems = []
    for port in recording.ports.values():
        if port.topic.startswith("stepbus/") or port.type in (*_JOINTS, *_SHAPELESS):
            continue
        try:
            if port.type == "Contacts/1":
                rows.append(ContactCurves(port))
            elif port.type == "Image/1":
                rows.append(Stills(port))
            else:
                rows.append(PortCurves(port, recording))
            if port.type == "BaseState/1":
                rows.append(BasePath(port))
        except StepbusError as exc:
            problems.append(unreadable(port, exc))
    return rows, problems
