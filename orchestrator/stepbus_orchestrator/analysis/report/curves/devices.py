"""The lines of a mobile manipulator's devices, taken from a recording piece by piece."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Batch, Port, Recording
from stepbus_schemas import Goal, Poses

from .curve import Curve, Line


class Columns:
    """Some fields of one port, all of them numbers: `columns["width"]` is a line."""

    def __init__(self, *fields: str) -> None:
        self._fields = fields
        self._curve = Curve()

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        self._curve.add(batch.t, rows_of(batch, self._fields))

    def __bool__(self) -> bool:
        """Return whether there is any message."""
        return self._curve.count > 0

    def __getitem__(self, field: str) -> Line:
        """Return one field over time."""
        return self._curve.line(self._fields.index(field))


def rows_of(batch: Batch, fields: Sequence[str]) -> Array:
    """Return some fields of a batch, shape (m, n)."""
    found = [[float(getattr(m, field)) for field in fields] for m in batch.messages()]
    return np.array(found).reshape(-1, len(fields))


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Where a base was at some time: t [s], x, y [m], yaw [rad]."""

    t: float
    x: float
    y: float
    yaw: float


class Path:
    """Where a base was: its points, and the ones at which it started, was farthest, and ended."""

    def __init__(self) -> None:
        self._curve = Curve(together=True)
        self._farthest = -1.0
        self.start = self.farthest = self.end = Stop(t=0.0, x=0.0, y=0.0, yaw=0.0)

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        if not len(batch.steps):
            return
        rows = np.column_stack((batch.t, rows_of(batch, ("x", "y", "yaw"))))
        if not self._curve.count:
            self.start = _stop(rows[0])
        distance = np.hypot(rows[:, 1] - self.start.x, rows[:, 2] - self.start.y)
        far = int(distance.argmax())
        if distance[far] > self._farthest:
            self._farthest, self.farthest = float(distance[far]), _stop(rows[far])
        self.end = _stop(rows[-1])
        self._curve.add(batch.t, rows[:, 1:3])

    def points(self) -> tuple[Array, Array]:
        """Return x and y, both of shape (p,), [m]."""
        return self._curve.line(0)[1], self._curve.line(1)[1]


def _stop(row: Array) -> Stop:
    t, x, y, yaw = map(float, row)
    return Stop(t=t, x=x, y=y, yaw=yaw)


class Height:
    """How high a link is. tip: its name."""

    def __init__(self, tip: str, index: int) -> None:
        self.tip = tip
        self._index = index
        self._curve = Curve()

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        at = self._index
        rows = [m.position[at][2] for m in batch.messages() if isinstance(m, Poses)]
        self._curve.add(batch.t, np.array(rows, dtype=float).reshape(-1, 1))

    def line(self) -> Line:
        """Return times [s] and heights [m]."""
        return self._curve.line(0)


class Devices:
    """What a recording has of a base, a gripper and the height of a tool; the first of each."""

    def __init__(self, recording: Recording) -> None:
        self.path, self.base = Path(), Columns("vx", "wz")
        self.gripper = Columns("width", "force", "holding")
        base, gripper = (_first(recording, name) for name in ("BaseState/1", "GripperState/1"))
        poses = moving_poses(recording) if base or gripper else None
        self.height = None if poses is None else _height(recording, poses)
        takers = {
            port: columns
            for port, columns in (
                (base, (self.base, self.path)),
                (gripper, (self.gripper,)),
                (poses, () if self.height is None else (self.height,)),
            )
            if port is not None and columns
        }
        for batch in recording.batches(takers):
            for port, columns in takers.items():
                for one in columns:
                    one.take(batch[port.topic])


def moving_poses(recording: Recording) -> Port | None:
    """Return the first port of poses that were published more than once, unlike a planogram."""
    return next((port for port in recording.of_type("Poses/1") if port.last_step > 0), None)


def _first(recording: Recording, type_name: str) -> Port | None:
    """Return the first port of a type that lasts; one message at the start is a map."""
    port = max(recording.of_type(type_name), key=lambda port: port.last_step, default=None)
    return port if port is not None and port.last_step >= 0 else None


def _height(recording: Recording, poses: Port) -> Height | None:
    """Return the height of the link that goals send to poses."""
    names = list(poses.names)
    tips = (
        goal.tip
        for port in recording.of_type("Goal/1")
        for _, goal in port.messages()
        if isinstance(goal, Goal)
    )
    tip = next((tip for tip in tips if tip and tip in names), None)
    return None if tip is None else Height(tip, names.index(tip))
