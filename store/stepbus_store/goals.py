"""A mission that sends goals to a controller, one after the other."""

import math
from collections.abc import Mapping
from typing import Annotated

import msgspec

from stepbus_participant import (
    Config,
    Finite,
    NonNegative,
    Participant,
    Ports,
    Positive,
    Settings,
    Step,
    Text,
    Vector3,
)
from stepbus_schemas import Event, Goal, GoalStatus, GoalType, Message, Quaternion, RunError, Spiral


class SpiralSettings(Settings):
    """A spiral around a vertical axis, which leads to `position`."""

    centre: Vector3
    """Point on the axis at the starting height [m]."""
    radius: tuple[Positive, Positive]
    """Radius at the start and at the end [m]."""
    turns: Finite
    """Number of turns, counter-clockwise [-]."""
    rise: Finite = 0.0
    """Total rise along the path [m]."""


class GoalSettings(Settings):
    """A goal; see `Goal/1`."""

    type: GoalType
    """Type of the goal."""
    joints: dict[str, Finite] = {}
    """For `move_joints`, and for `back_to_rest` without a pose: joint → position [rad]."""
    tip: str = ""
    """Frame of the robot to move."""
    frame: str = ""
    """Reference frame of the pose: a link, `odometry`, or the robot's base if empty."""
    position: Vector3 | None = None
    """Target position of the tip [m]."""
    rpy: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the tip about fixed axes [rad]."""
    spiral: SpiralSettings | None = None
    """With `spiral`: the spiral."""
    duration: NonNegative = 0.0
    """Duration of the motion [s]; 0: as fast as the limits allow."""
    touches: tuple[Text, ...] = ()
    """Links of the world that the robot may touch."""
    by: Finite = 0.0
    """For `drive` and `turn`: distance or angle [m, rad]."""
    base: Vector3 | None = None
    """For `go_to`: target x, y, yaw [m, m, rad]."""
    width: NonNegative = 0.0
    """For `grip`: target distance between the pads [m]."""
    force: NonNegative = 0.0
    """For `grip`: maximum force of each finger [N]."""

    def goal(self, number: int) -> Goal:
        """Return the goal with an id."""
        spiral, fields = self.spiral, msgspec.structs.asdict(self)
        del fields["rpy"]
        fields |= {
            "id": number,
            "joints": list(self.joints),
            "values": list(self.joints.values()),
            "orientation": None if self.position is None else _quaternion(self.rpy),
            "spiral": None if spiral is None else Spiral(**msgspec.structs.asdict(spiral)),
            "touches": list(self.touches),
        }
        return Goal(**fields)


class Params(Settings):
    """Parameters of `stepbus_store.goals`."""

    goals: Annotated[tuple[GoalSettings, ...], msgspec.Meta(min_length=1)]
    """Goals, in order. The run ends after the last one or the first failure."""


def _quaternion(rpy: tuple[float, float, float]) -> Quaternion:
    """Return the quaternion x, y, z, w of roll, pitch, yaw about fixed axes [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in rpy)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


class GoalSequence(Participant):
    """Sends the next goal when the one before has succeeded, and ends the run after the last one.

    Input: one GoalStatus/1. Outputs: one Goal/1, and an Event/1 for every goal that is accepted or
    ends. Raises RunError if a goal fails. Parameters: see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._status_port = ports.input_of("GoalStatus/1")
        self._goal_port = ports.output_of("Goal/1")
        self._event_port = ports.output_of("Event/1")
        ports.outputs_are("Goal/1", "Event/1")
        self._goals = config.read(Params, ports.problems).goals
        self._number = -1
        self._reported = ""

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the next goal once the last one is over, and the event of its result."""
        if self._number < 0:
            return self._next(step)
        status = step.get(self._status_port, GoalStatus)
        if status is None or status.id != self._number or self._number >= len(self._goals):
            return {}
        goal = f"goal {self._number + 1} of {len(self._goals)} ({self._goals[self._number].type})"
        text = f"{goal}: {status.state}, {status.text}"
        if status.state in {"failed", "cancelled"}:
            raise RunError(f"{goal} {status.state}: {status.text or status.cause}")
        if status.state == "running" or text == self._reported:
            return {}
        self._reported = text
        event = {self._event_port: Event(level="info", text=text)}
        return event if status.state == "accepted" else {**event, **self._next(step)}

    def _next(self, step: Step) -> dict[str, Message]:
        self._number += 1
        if self._number < len(self._goals):
            return {self._goal_port: self._goals[self._number].goal(self._number)}
        step.end(f"{len(self._goals)} of {len(self._goals)} goals are done")
        return {}

    def save(self) -> bytes:
        """Return how far it is."""
        return msgspec.msgpack.encode((self._number, self._reported))

    def restore(self, state: bytes) -> None:
        """Take a state from `save`."""
        self._number, self._reported = msgspec.msgpack.decode(state)
