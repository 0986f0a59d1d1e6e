"""Drives turn joint commands into forces: one class per mode."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, ClassVar

import pybullet as bullet

from stepbus_plant.joint import Joint
from stepbus_schemas import JointCommand

# A velocity the motor never reaches, so that it always applies its maximum force.
_UNREACHED_VELOCITY = 1e4

Indices = Sequence[tuple[int, int]]
"""Pairs of a joint's index in its drive and in the vectors of a command."""


class Drive:
    """Joints of one body with the same mode and actuation, and the latest target of each.

    client: of PyBullet. joints: each keeps its target until a command names it again, even if
    another input commands the drive's other joints. substep_s: length of a physics substep [s].
    """

    remembers: ClassVar[tuple[str, ...]] = ()
    """The attributes that commands and steps change."""

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        self.joints = list(joints)
        self._client = client
        self._substep_s = substep_s
        self._body = joints[0].body
        self._indices = [joint.index for joint in joints]
        self._efforts = [joint.effort for joint in joints]

    def command(self, command: JointCommand, indices: Indices, period: int) -> None:
        """Set the targets of some of the joints.

        period: substeps until the next command is due.
        """

    def teleport(self, index: int, position: float) -> None:
        """React to the teleport of a joint to a position [rad]."""

    def brake(self, index: int, position: float) -> None:
        """Hold a joint at its current `position` [rad] until the next command."""

    def save(self) -> dict[str, Any]:
        """Return its latest targets, for a checkpoint."""
        return {key: getattr(self, key) for key in self.remembers}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Take what `save` returned, and set the engine's motors accordingly."""
        for key in self.remembers:
            setattr(self, key, saved[key])

    def before_substep(self) -> None:
        """Pass new targets to the physics engine."""

    def followed(self, index: int, position: float, dt: float) -> tuple[float, float]:
        """Return position and velocity of a joint after dt [s], if it follows at once [rad, rad/s].

        position: of now. What nothing drives stays where it is.
        """
        return position, 0.0

    def torques(self) -> list[float] | None:
        """Return the torques applied last [N·m], if the engine does not report them."""
        return None

    def targets(self) -> list[float] | None:
        """Return the latest position targets [rad], if the mode has any."""
        return None


class DirectTorque(Drive):
    """Mode torque: the engine applies the torque directly."""

    remembers: ClassVar[tuple[str, ...]] = ("_wanted", "_applied")

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
        self._wanted = [0.0] * len(joints)
        self._applied = self._wanted
        self._braked: set[int] = set()

    def command(self, command: JointCommand, indices: Indices, period: int) -> None:
        """Set torques, saturated at the joints' limits; this releases the brake."""
        values, efforts = command.values, self._efforts
        wanted = self._wanted.copy()
        for index, source in indices:
            wanted[index] = _clip(values[source], efforts[index])
            if index in self._braked:
                self._braked.remove(index)
                self._resist(index, self.joints[index].friction)
        self._wanted = wanted

    def brake(self, index: int, position: float) -> None:
        """Hold the joint with the engine's motor, whose torque is not reported."""
        self._wanted = self._wanted.copy()
        self._wanted[index] = 0.0
        self._braked.add(index)
        self._resist(index, self._efforts[index])

    def save(self) -> dict[str, Any]:
        """See `Drive`."""
        return {**super().save(), "braked": sorted(self._braked)}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """See `Drive`."""
        super().restore(saved)
        self._braked = set(saved["braked"])
        for index in self._braked:
            self._resist(index, self._efforts[index])

    def _resist(self, index: int, force: float) -> None:
        """Let the engine resist any motion of a joint with up to this torque [N·m]."""
        bullet.setJointMotorControl2(
            self._body,
            self._indices[index],
            bullet.VELOCITY_CONTROL,
            targetVelocity=0.0,
            force=force,
            physicsClientId=self._client,
        )

    def before_substep(self) -> None:
        """Apply the torques; the engine forgets them after every substep."""
        self._applied = self._wanted
        bullet.setJointMotorControlArray(
            self._body,
            self._indices,
            bullet.TORQUE_CONTROL,
            forces=self._applied,
            physicsClientId=self._client,
        )

    def torques(self) -> list[float] | None:
        """Return the torques applied last [N·m]; the engine does not report them."""
        return self._applied


class _Motors(Drive):
    """Motors of the engine, which keep their targets from one substep to the next.

    _velocities: targets [rad/s]. _forces: torque limits [N·m].
    """

    remembers: ClassVar[tuple[str, ...]] = ("_velocities", "_forces")

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
        self._velocities = [0.0] * len(joints)
        self._forces = self._efforts.copy()
        self._changed = True

    def restore(self, saved: Mapping[str, Any]) -> None:
        """See `Drive`."""
        super().restore(saved)
        self._changed = True

    def _set_limit(self, command: JointCommand, index: int, source: int) -> None:
        own = self._efforts[index]
        limit = command.effort_limit
        self._forces[index] = own if limit is None else min(limit[source], own)

    def brake(self, index: int, position: float) -> None:
        """Hold the joint with its full torque."""
        self._velocities[index], self._forces[index] = 0.0, self._efforts[index]
        self._changed = True

    def before_substep(self) -> None:
        """Set the motors if a command has changed them."""
        if self._changed:
            self._changed = False
            self._set()

    def _set(self) -> None:
        bullet.setJointMotorControlArray(
            self._body,
            self._indices,
            bullet.VELOCITY_CONTROL,
            targetVelocities=self._velocities,
            forces=self._forces,
            physicsClientId=self._client,
        )


class VelocityForce(_Motors):
    """Mode torque for simulators without a torque input.

    A motor with an unreachable target velocity and the force limit |τ| applies τ.
    """

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
        self._forces = [0.0] * len(joints)

    def command(self, command: JointCommand, indices: Indices, period: int) -> None:
        """Set torques, saturated at the joints' limits."""
        for index, source in indices:
            torque = command.values[source]
            self._velocities[index] = math.copysign(_UNREACHED_VELOCITY, torque)
            self._forces[index] = min(abs(torque), self._efforts[index])
        self._changed = True


class VelocityMotor(_Motors):
    """Mode velocity: a motor that tracks a velocity with limited torque."""

    def command(self, command: JointCommand, indices: Indices, period: int) -> None:
        """Set velocities, saturated at the joints' limits."""
        for index, source in indices:
            limit = self.joints[index].max_velocity or math.inf
            self._velocities[index] = _clip(command.values[source], limit)
            self._set_limit(command, index, source)
        self._changed = True

    def followed(self, index: int, position: float, dt: float) -> tuple[float, float]:
        """Return where its velocity takes a joint, no further than to its stops."""
        joint, velocity = self.joints[index], self._velocities[index]
        return min(max(position + velocity * dt, joint.lower), joint.upper), velocity


class PositionMotor(_Motors):
    """Mode position: a motor that tracks a target with limited torque and velocity.

    A target with a feed-forward velocity keeps moving until the next command is due, as in a drive
    commanded with position, velocity and time. With a constant target the joint would track a
    staircase, and lag behind.
    """

    remembers: ClassVar[tuple[str, ...]] = (*_Motors.remembers, "_commanded", "_age", "_moving")

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
        self._commanded = [joint.start for joint in joints]
        self._age = [0] * len(joints)
        self._moving: dict[int, int] = {}

    def command(self, command: JointCommand, indices: Indices, period: int) -> None:
        """Set targets and feed-forward velocities."""
        feed_forward = command.velocity
        for index, source in indices:
            self._hold(index, command.values[source])
            self._set_limit(command, index, source)
            if feed_forward is not None and feed_forward[source] != 0.0:
                self._velocities[index] = feed_forward[source]
                self._moving[index] = period
        self._changed = True

    def _hold(self, index: int, position: float) -> None:
        """Set a constant target for a joint [rad]."""
        self._commanded[index], self._velocities[index] = position, 0.0
        self._age[index] = 0
        self._moving.pop(index, None)

    def teleport(self, index: int, position: float) -> None:
        """Hold the new position instead of pulling the joint back."""
        self._hold(index, position)
        self._changed = True

    def brake(self, index: int, position: float) -> None:
        """Hold the joint at its current position."""
        super().brake(index, position)
        self._hold(index, position)

    def followed(self, index: int, position: float, dt: float) -> tuple[float, float]:
        """Return the target, and its velocity."""
        return self._target(index), self._velocities[index]

    def targets(self) -> list[float] | None:
        """Return the current targets, limited to the joints' stops [rad]."""
        return [self._target(index) for index in range(len(self.joints))]

    def _target(self, index: int) -> float:
        joint = self.joints[index]
        travel = self._velocities[index] * self._age[index] * self._substep_s
        return min(max(self._commanded[index] + travel, joint.lower), joint.upper)

    def before_substep(self) -> None:
        """Set the motors if a command has changed them, and advance the moving targets."""
        super().before_substep()
        for index, period in list(self._moving.items()):
            if self._age[index] >= period:
                self._hold(index, self._target(index))
            self._set_one(index)
            self._age[index] += 1 if index in self._moving else 0

    def _set(self) -> None:
        for index in range(len(self.joints)):
            self._set_one(index)

    def _set_one(self, index: int) -> None:
        joint = self.joints[index]
        limit = {"maxVelocity": joint.max_velocity} if joint.max_velocity > 0 else {}
        bullet.setJointMotorControl2(
            self._body,
            joint.index,
            bullet.POSITION_CONTROL,
            targetPosition=self._target(index),
            targetVelocity=self._velocities[index],
            force=self._forces[index],
            physicsClientId=self._client,
            **limit,
        )


def _clip(value: float, limit: float) -> float:
    return -limit if value < -limit else min(value, limit)


def make_drives(client: int, joints: Iterable[Joint], substep_s: float) -> list[Drive]:
    """Return one drive per body, mode and actuation: one engine call each per substep.

    substep_s: length of a physics substep [s].
    """

    def key(joint: Joint) -> tuple[int, str, str]:
        return (joint.body, joint.effective_mode, joint.actuation)

    groups = [list(group) for _, group in groupby(sorted(joints, key=key), key)]
    return [_class_for(group[0])(client, group, substep_s) for group in groups]


def locate_joints(drives: Iterable[Drive]) -> dict[str, tuple[Drive, int]]:
    """Return joint name → its drive, and its index in the drive."""
    return {joint.name: (drive, i) for drive in drives for i, joint in enumerate(drive.joints)}


def _class_for(joint: Joint) -> type[Drive]:
    torque = DirectTorque if joint.actuation == "direct" else VelocityForce
    # Nothing drives a joint of mode teleport, which jumps to each commanded position, or a passive
    # one.
    classes: dict[str, type[Drive]] = {
        "torque": torque,
        "velocity": VelocityMotor,
        "position": PositionMotor,
        "teleport": Drive,
        "passive": Drive,
    }
    return classes[joint.effective_mode]
