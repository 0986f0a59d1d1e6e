"""The parameters of a mission that publishes references."""

from collections.abc import Iterator
from typing import Annotated, Literal

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
    when,
)
from stepbus_participant.parameters import Keys


class Waypoint(Settings):
    """A position, and its time or the duration of the motion to it."""

    time: NonNegative | None = None
    """Simulation time [s]. Default for the first waypoint: 0."""
    duration: Positive | None = None
    """Time since the previous waypoint, instead of `time` [s]."""
    position: PerJoint
    """Position of each joint [rad]."""


class Params(Settings):
    """Parameters of `stepbus_mission`."""

    task: Literal["csv", "sine", "step", "waypoints"] | Plugin
    """What the reference does; your own class has `__init__(joints, params)` and `at(t)`."""
    joints: Names
    """Joints of the reference, in the order of its vectors."""
    prefix: str = ""
    """Prefix that the plant adds to the joint names of this robot: `left/` where two bodies of one
    URDF share a world. All other parameters name joints without it."""
    end_when_done: bool = False
    """Whether the run ends when the task is done."""
    amplitude: Annotated[PerJoint, when(task="sine")] = each(1.0)
    """A of q(t) = q0 + A · sin(ω t + φ) [rad]."""
    omega: Annotated[PerJoint, when(task="sine")] = each(1.0)
    """ω [rad/s]."""
    phase: Annotated[PerJoint, when(task="sine")] = each(0.0)
    """φ [rad]."""
    offset: Annotated[PerJoint, when(task="sine")] = each(0.0)
    """q0 [rad]."""
    target: Annotated[PerJoint, when(task="step")]
    """Position from `time` on [rad]."""
    initial: Annotated[PerJoint, when(task="step")] = each(0.0)
    """Position before `time` [rad]."""
    time: Annotated[Finite, when(task="step")] = 0.0
    """Time at which the position changes [s]."""
    waypoints: Annotated[tuple[Waypoint, ...], when(task="waypoints")]
    """At least two: `{time: 2, position: [0.5, 0]}`, or `{duration: 2, position: …}` from the
    second on. The joints come to rest at each, with minimum jerk in between."""
    file: Annotated[File, when(task="csv")]
    """Columns `t` [s], increasing, `<joint>` [rad] and, where known, `<joint>_velocity` [rad/s]
    and `<joint>_acceleration` [rad/s²]. Between two rows a joint moves by a polynomial through all
    that its columns give."""
    own: Own = {}

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong between the waypoints."""
        if self.end_when_done and self.task in ("sine", "step"):
            yield ("end_when_done",), "is true, but this task never ends"
        if self.task != "waypoints":
            return
        if len(self.waypoints) < 2:
            yield ("waypoints",), f"has {len(self.waypoints)} waypoint, needs at least two"
        now = 0.0
        for number, row in enumerate(self.waypoints):
            for where, text in row.position.misfits(self.joints):
                yield ("waypoints", number, "position", *where), text
            for where, text in _time_problems(row, now, number):
                yield ("waypoints", number, *where), text
            now = time_of(row, now)


def time_of(row: Waypoint, before: float) -> float:
    """Return the time of a waypoint [s]; before: that of the one before it [s]."""
    if row.duration is not None:
        return before + row.duration
    return 0.0 if row.time is None else row.time


def _time_problems(row: Waypoint, before: float, number: int) -> Iterator[tuple[Keys, str]]:
    if number == 0:
        if row.duration is not None:
            yield (), "the first waypoint has a 'time', no 'duration'"
    elif (row.time is None) == (row.duration is None):
        yield (), "needs either a 'time' or a 'duration'"
    elif row.time is not None and row.time <= before:
        yield ("time",), f"is {row.time:g} s, not after the one before ({before:g} s)"
