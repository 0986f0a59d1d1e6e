"""The parameters of a mission that publishes references."""

from collections.abc import Iterator
from typing import Literal

from stepbus_participant import (
    File,
    Finite,
    Names,
    NonNegative,
    Own,
    PerJoint,
    Plugin,
    Positive,
    Settings,
    each,
)
from stepbus_participant.parameters import Keys


class Waypoint(Settings):
    """A position, and its time or the duration of the motion to it."""

    time: NonNegative | None = None
    """Simulation time of the waypoint [s]. Default for the first one: 0."""
    duration: Positive | None = None
    """Time since the previous waypoint, instead of `time` [s]."""
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
    """At least two: `{time: 2, position: [0.5, 0]}`, or `{duration: 2, position: …}` from the
    second on. Minimum-jerk motions connect them; the joints stop at each."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield mistakes in the waypoints: their number, positions and times."""
        if len(self.waypoints) < 2:
            yield ("waypoints",), f"has {len(self.waypoints)} waypoint; it needs at least two"
        now = 0.0
        for number, row in enumerate(self.waypoints):
            for where, text in row.position.misfits(self.joints):
                yield ("waypoints", number, "position", *where), text
            for where, text in _time_problems(row, now, number):
                yield ("waypoints", number, *where), text
            now = time_of(row, now)


class TableParams(Params):
    """Parameters of `stepbus_mission` with `task: csv`."""

    file: File
    """Columns `t` [s], increasing, `<joint>` [rad] and optionally `<joint>_velocity` [rad/s]
    and `<joint>_acceleration` [rad/s²]. Between two rows a polynomial interpolates all the
    given values of a joint."""


_TASKS = {"csv": TableParams, "sine": SineParams, "step": StepParams, "waypoints": WaypointParams}
Params.kinds = ("task", _TASKS)


def time_of(row: Waypoint, before: float) -> float:
    """Return the time of a waypoint [s]; before: that of the one before it [s]."""
    if row.duration is not None:
        return before + row.duration
    return 0.0 if row.time is None else row.time


def _time_problems(row: Waypoint, before: float, number: int) -> Iterator[tuple[Keys, str]]:
    if number == 0:
        if row.duration is not None:
            yield (), "the first waypoint takes a 'time', not a 'duration'"
    elif (row.time is None) == (row.duration is None):
        yield (), "needs either a 'time' or a 'duration'"
    elif row.time is not None and row.time <= before:
        yield ("time",), f"is {row.time:g} s; it must be after the previous waypoint ({before:g} s)"
