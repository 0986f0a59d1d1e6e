"""How a command reaches the motors: one seam, one implementation per way of actuation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from stepbus_schemas import JointCommand

from .joints import Joint
from .physics import Physics

UNREACHABLE_VELOCITY = 1e4
"""A target that keeps a velocity motor at its largest torque [rad/s]."""
LOCK_EFFORT = 1e6
"""Torque with which a teleported joint stays where it was put [N·m]."""


class Actuator(Protocol):
    """Some joints of one body that are driven in the same way."""

    def take(self, command: JointCommand) -> None:
        """Keep what a valid command asks of these joints, saturated at their limits."""

    def drive(self) -> None:
        """Set the motors for the next substep."""


@dataclass(frozen=True)
class Motors:
    """What all actuators know.

    places: where each joint stands in the command's vectors. applied: directly applied torque of
    each joint of the plant [N·m], written here because PyBullet does not read it back. slots:
    where each joint stands in it.
    """

    physics: Physics
    joints: Sequence[Joint]
    places: Sequence[int]
    applied: list[float]
    slots: Sequence[int]

    @property
    def body(self) -> int:
        """Return PyBullet's number of the body."""
        return self.joints[0].body

    @property
    def indices(self) -> list[int]:
        """Return PyBullet's numbers of the joints."""
        return [joint.index for joint in self.joints]

    @property
    def bounds(self) -> list[tuple[int, Joint]]:
        """Return where each joint stands in the command's vectors, and the joint."""
        return list(zip(self.places, self.joints, strict=True))


class DirectTorque:
    """Mode torque, applied as such."""

    def __init__(self, motors: Motors) -> None:
        self._apply = motors.physics.drive_torques
        self._body, self._indices = motors.body, motors.indices
        self._applied = motors.applied
        self._bounds = [
            (place, joint.effort, slot)
            for (place, joint), slot in zip(motors.bounds, motors.slots, strict=True)
        ]
        self._torques = [0.0] * len(self._indices)

    def take(self, command: JointCommand) -> None:
        """Keep the torques."""
        values = command.values
        self._torques = [_clip(values[place], -limit, limit) for place, limit, _ in self._bounds]
        for (_, _, slot), torque in zip(self._bounds, self._torques, strict=True):
            self._applied[slot] = torque

    def drive(self) -> None:
        """Apply the torques; PyBullet forgets them after each substep."""
        self._apply(self._body, self._indices, self._torques)


class VelocityForce:
    """Mode torque as a velocity motor that never gets there, with |torque| as its maximum force."""

    def __init__(self, motors: Motors) -> None:
        self._drive = motors.physics.drive_velocities
        self._body, self._indices = motors.body, motors.indices
        self._bounds = [(place, joint.effort) for place, joint in motors.bounds]
        self._targets = [0.0] * len(self._indices)
        self._efforts = [0.0] * len(self._indices)

    def take(self, command: JointCommand) -> None:
        """Keep sign and size of the torques."""
        torques = [(command.values[place], limit) for place, limit in self._bounds]
        self._targets = [math.copysign(UNREACHABLE_VELOCITY, torque) for torque, _ in torques]
        self._efforts = [min(abs(torque), limit) for torque, limit in torques]

    def drive(self) -> None:
        """Set the motors."""
        self._drive(self._body, self._indices, self._targets, self._efforts)


class VelocityMotor:
    """Mode velocity."""

    def __init__(self, motors: Motors) -> None:
        self._motors = motors
        self._body, self._indices = motors.body, motors.indices
        self._velocities: list[float] = []
        self._efforts: list[float] = []

    def take(self, command: JointCommand) -> None:
        """Keep velocities and torque limits."""
        self._velocities = _velocities(self._motors, command.values)
        self._efforts = _efforts(self._motors, command.effort_limit)

    def drive(self) -> None:
        """Set the motors."""
        self._motors.physics.drive_velocities(
            self._body, self._indices, self._velocities, self._efforts
        )


class PositionMotor:
    """Mode position, with PyBullet's own position loop."""

    def __init__(self, motors: Motors) -> None:
        self._motors = motors
        self._body, self._indices = motors.body, motors.indices
        self._positions: list[float] = []
        self._velocities: list[float] = []
        self._efforts: list[float] = []

    def take(self, command: JointCommand) -> None:
        """Keep targets, feed-forward velocities (0 where absent) and torque limits."""
        self._positions = _positions(self._motors, command.values)
        feed_forward = command.velocity or [0.0] * len(command.values)
        self._velocities = _velocities(self._motors, feed_forward)
        self._efforts = _efforts(self._motors, command.effort_limit)

    def drive(self) -> None:
        """Set the motors."""
        self._motors.physics.drive_positions(
            self._body, self._indices, self._positions, self._velocities, self._efforts
        )


class Teleport:
    """Mode teleport: the joints jump, come to rest, and are held there."""

    def __init__(self, motors: Motors) -> None:
        self._motors = motors
        self._body, self._indices = motors.body, motors.indices
        self._positions: list[float] = []

    def take(self, command: JointCommand) -> None:
        """Keep the positions."""
        self._positions = _positions(self._motors, command.values)

    def drive(self) -> None:
        """Put the joints there and hold them against load."""
        physics = self._motors.physics
        for index, position in zip(self._indices, self._positions, strict=True):
            physics.place(self._body, index, position, 0.0)
        count = len(self._indices)
        physics.drive_velocities(self._body, self._indices, [0.0] * count, [LOCK_EFFORT] * count)


def make_actuator(motors: Motors) -> Actuator:
    """Return the actuator for joints that all have the same mode and actuation."""
    joint = motors.joints[0]
    if joint.mode == "torque":
        return DirectTorque(motors) if joint.actuation == "direct" else VelocityForce(motors)
    if joint.mode == "velocity":
        return VelocityMotor(motors)
    return PositionMotor(motors) if joint.mode == "position" else Teleport(motors)


def _clip(value: float, lower: float, upper: float) -> float:
    return lower if value < lower else min(value, upper)


def _positions(motors: Motors, values: Sequence[float]) -> list[float]:
    return [_clip(values[place], joint.lower, joint.upper) for place, joint in motors.bounds]


def _velocities(motors: Motors, values: Sequence[float]) -> list[float]:
    rows = [(values[place], joint.max_velocity) for place, joint in motors.bounds]
    return [_clip(value, -limit, limit) for value, limit in rows]


def _efforts(motors: Motors, limits: Sequence[float] | None) -> list[float]:
    if limits is None:
        return [joint.effort for joint in motors.joints]
    return [min(limits[place], joint.effort) for place, joint in motors.bounds]
