"""How joint commands become forces: one small class per mode, one seam."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby

import pybullet as bullet

from stepbus_schemas import JointCommand

from .joints import Joint

# Any velocity that is never reached: the motor then always pulls with its maximum force.
_UNREACHED_VELOCITY = 1e4

Rows = Sequence[tuple[int, int]]
"""Pairs of a joint's place in its drive and its place in the vectors of a command."""


class Drive:
    """Joints of one body that are driven alike, and the newest target of each.

    client: of PyBullet. joints: all of one body, mode and actuation; each keeps its target until
    a command has another one for it, whoever commands the other joints of the drive.
    """

    def __init__(self, client: int, joints: Sequence[Joint]) -> None:
        self.joints = list(joints)
        self._client = client
        self._body = joints[0].body
        self._indices = [joint.index for joint in joints]
        self._efforts = [joint.effort for joint in joints]

    def take(self, command: JointCommand, rows: Rows) -> None:
        """Take in what a command says about some of the joints."""

    def jumped(self, place: int, position: float) -> None:
        """Take in that the joint at a place was teleported to a position [rad]."""

    def brake(self, place: int, position: float) -> None:
        """Hold the joint at a place where it is, at `position` [rad], until the next command."""

    def before_substep(self) -> None:
        """Hand to the physics engine what it does not know yet."""

    def torques(self) -> list[float] | None:
        """Return the torques applied last [N·m], where the engine cannot be asked for them."""
        return None

    def targets(self) -> list[float] | None:
        """Return the newest position targets [rad], where there are any."""
        return None


class DirectTorque(Drive):
    """Mode torque: the engine applies the torque itself."""

    def __init__(self, client: int, joints: Sequence[Joint]) -> None:
        super().__init__(client, joints)
        self._wanted = [0.0] * len(joints)
        self._applied = self._wanted
        self._braked: set[int] = set()

    def take(self, command: JointCommand, rows: Rows) -> None:
        """Take in torques, cut at the joints' limits; a joint that is driven has its brake off."""
        values, efforts = command.values, self._efforts
        wanted = self._wanted.copy()
        for place, source in rows:
            wanted[place] = _clip(values[source], efforts[place])
            if place in self._braked:
                self._braked.remove(place)
                self._still(place, self.joints[place].friction)
        self._wanted = wanted

    def brake(self, place: int, position: float) -> None:
        """Hold the joint by the engine's motor; its torque is not among those applied."""
        self._wanted = self._wanted.copy()
        self._wanted[place] = 0.0
        self._braked.add(place)
        self._still(place, self._efforts[place])

    def _still(self, place: int, force: float) -> None:
        """Let the engine resist all motion of a joint with a torque [N·m]."""
        bullet.setJointMotorControl2(
            self._body,
            self._indices[place],
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
        """Return the torques applied last [N·m]; the engine reports none in this mode."""
        return self._applied


class _Motors(Drive):
    """Motors of the engine, which keep their targets from substep to substep.

    _velocities: to reach [rad/s]. _forces: largest torques to do it with [N·m].
    """

    def __init__(self, client: int, joints: Sequence[Joint]) -> None:
        super().__init__(client, joints)
        self._velocities = [0.0] * len(joints)
        self._forces = self._efforts.copy()
        self._changed = True

    def _take_limit(self, command: JointCommand, place: int, source: int) -> None:
        own = self._efforts[place]
        limit = command.effort_limit
        self._forces[place] = own if limit is None else min(limit[source], own)

    def brake(self, place: int, position: float) -> None:
        """Hold the joint with all the torque it has."""
        self._velocities[place], self._forces[place] = 0.0, self._efforts[place]
        self._changed = True

    def before_substep(self) -> None:
        """Set the motors, where a command has changed them."""
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
    """Mode torque as simulators without a torque input know it.

    A motor that shall reach an unreachable velocity with at most the force |τ| applies τ.
    """

    def __init__(self, client: int, joints: Sequence[Joint]) -> None:
        super().__init__(client, joints)
        self._forces = [0.0] * len(joints)

    def take(self, command: JointCommand, rows: Rows) -> None:
        """Take in torques, cut at the joints' limits."""
        for place, source in rows:
            torque = command.values[source]
            self._velocities[place] = math.copysign(_UNREACHED_VELOCITY, torque)
            self._forces[place] = min(abs(torque), self._efforts[place])
        self._changed = True


class VelocityMotor(_Motors):
    """Mode velocity: a motor that holds a velocity with limited torque."""

    def take(self, command: JointCommand, rows: Rows) -> None:
        """Take in velocities, cut at the joints' limits."""
        for place, source in rows:
            limit = self.joints[place].max_velocity or math.inf
            self._velocities[place] = _clip(command.values[source], limit)
            self._take_limit(command, place, source)
        self._changed = True


class PositionMotor(_Motors):
    """Mode position: a motor that follows a target with limited torque and velocity."""

    def __init__(self, client: int, joints: Sequence[Joint]) -> None:
        super().__init__(client, joints)
        self._targets = [joint.start for joint in joints]

    def take(self, command: JointCommand, rows: Rows) -> None:
        """Take in targets and feed-forward velocities, without which the joint lags behind."""
        ahead = command.velocity
        for place, source in rows:
            joint = self.joints[place]
            self._targets[place] = min(max(command.values[source], joint.lower), joint.upper)
            self._velocities[place] = 0.0 if ahead is None else ahead[source]
            self._take_limit(command, place, source)
        self._changed = True

    def jumped(self, place: int, position: float) -> None:
        """Hold the new position, instead of pulling the joint back."""
        self._targets[place], self._velocities[place] = position, 0.0
        self._changed = True

    def brake(self, place: int, position: float) -> None:
        """Hold the joint where it is."""
        super().brake(place, position)
        self._targets[place] = position

    def targets(self) -> list[float] | None:
        """Return the newest targets, cut at the joints' stops [rad]."""
        return self._targets

    def _set(self) -> None:
        for place, joint in enumerate(self.joints):
            limit = {"maxVelocity": joint.max_velocity} if joint.max_velocity > 0 else {}
            bullet.setJointMotorControl2(
                self._body,
                joint.index,
                bullet.POSITION_CONTROL,
                targetPosition=self._targets[place],
                targetVelocity=self._velocities[place],
                force=self._forces[place],
                physicsClientId=self._client,
                **limit,
            )


def _clip(value: float, limit: float) -> float:
    return -limit if value < -limit else min(value, limit)


def make_drives(client: int, joints: Iterable[Joint]) -> list[Drive]:
    """Return one drive per body, mode and actuation, so that each is one call a substep."""

    def key(joint: Joint) -> tuple[int, str, str]:
        return (joint.body, joint.mode, joint.actuation)

    groups = [list(group) for _, group in groupby(sorted(joints, key=key), key)]
    return [_class_for(group[0])(client, group) for group in groups]


def _class_for(joint: Joint) -> type[Drive]:
    torque = DirectTorque if joint.actuation == "direct" else VelocityForce
    # Nothing drives a joint of mode teleport; it is put where a command says.
    classes: dict[str, type[Drive]] = {
        "torque": torque,
        "velocity": VelocityMotor,
        "position": PositionMotor,
        "teleport": Drive,
    }
    return classes[joint.mode]
