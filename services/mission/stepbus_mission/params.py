"""The parameters of a mission that publishes references."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal

from stepbus_participant import (
    File,
    Finite,
    Names,
    NonNegative,
    Own,
    PerJoint,
    Plugin,
    Settings,
    each,
)
from stepbus_participant.parameters import Keys


class Waypoint(Settings):
    """A position, and when the joints are there."""

    time: NonNegative
    """Simulation time of the waypoint [s]."""
    position: PerJoint
    """Position of each joint [rad]."""


class Params(Settings):
    """Parameters of `stepbus_mission`."""

    task: Literal["csv", "sine", "step", "waypoints"] | Plugin
    """Shape of the reference. Your own class needs `__init__(joints, params)` and `at(t)`."""
    joints: Names
    """Joints of the reference, in this order."""
    prefix: str = ""
    """Prefix of this robot's joint names in the plant, such as `left/` if two bodies from one
    URDF share a world. All other parameters name joints without it."""
    end_when_done: bool = False
    """Whether the run ends when the task is done."""
    own: Own = {}

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield that a run cannot end with its task."""
        if self.end_when_done and self.task in ("sine", "step"):
            yield ("end_when_done",), "is true, but this task never ends"


class SineParams(Params):
    """Parameters of `stepbus_mission` with `task: sine`."""

    amplitude: PerJoint = each(1.0)
    """Amplitude A in q(t) = q0 + A · sin(ω t + φ) [rad]."""
    omega: PerJoint = each(1.0)
    """ω [rad/s]."""
    phase: PerJoint = each(0.0)
    """φ [rad]."""
    offset: PerJoint = each(0.0)
    """q0 [rad]."""


class StepParams(Params):
    """Parameters of `stepbus_mission` with `task: step`."""

    target: PerJoint
    """Position from `time` on [rad]."""
    initial: PerJoint = each(0.0)
    """Position before `time` [rad]."""
    time: Finite = 0.0
    """Time at which the position changes [s]."""


class WaypointParams(Params):
    """Parameters of `stepbus_mission` with `task: waypoints`."""

    waypoints: tuple[Waypoint, ...]
    """At least two, such as `{time: 2, position: [0.5, 0]}`. Minimum-jerk motions connect them; the
    joints stop at each."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield mistakes in the waypoints: their number, positions and times."""
        if len(self.waypoints) < 2:
            yield ("waypoints",), f"has {len(self.waypoints)} waypoint; it needs at least two"
        for number, row in enumerate(self.waypoints):
            for where, text in row.position.misfits(self.joints):
                yield ("waypoints", number, "position", *where), text
        for number, (before, row) in enumerate(pairwise(self.waypoints), 1):
            if row.time <= before.time:
                text = f"is {row.time:g} s; it must be after the previous one ({before.time:g} s)"
                yield ("waypoints", number, "time"), text


class TableParams(Params):
    """Parameters of `stepbus_mission` with `task: csv`."""

    file: File
    """Columns `t` [s], increasing, and `<joint>` [rad]. A natural cubic spline goes through the
    rows."""


_TASKS = {"csv": TableParams, "sine": SineParams, "step": StepParams, "waypoints": WaypointParams}
Params.kinds = ("task", _TASKS)
