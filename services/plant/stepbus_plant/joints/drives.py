"""How joint commands become forces: one small class per mode, one seam."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby

import pybullet as bullet

from stepbus_plant.physics.joint import Joint
from stepbus_schemas import JointCommand

# Any velocity that is never reached: the motor then always pulls with its maximum force.
_UNREACHED_VELOCITY = 1e4

Rows = Sequence[tuple[int, int]]
"""Pairs of a joint's place in its drive and its place in the vectors of a command."""


class Drive:
    """Joints of one body that are driven alike, and the newest target of each.

    client: of PyBullet. joints: all of one body, mode and actuation; each keeps its target until
    a command has another one for it, whoever commands the other joints of the drive. substep_s:
    length of a physics substep [s].
    """

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        self.joints = list(joints)
        self._client = client
        self._substep_s = substep_s
        self._body = joints[0].body
        self._indices = [joint.index for joint in joints]
        self._efforts = [joint.effort for joint in joints]

    def take(self, command: JointCommand, rows: Rows, period: int) -> None:
        """Take in what a command says about some of the joints.

        period: substeps until the next command is due.
        """

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

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
        self._wanted = [0.0] * len(joints)
        self._applied = self._wanted
        self._braked: set[int] = set()

    def take(self, command: JointCommand, rows: Rows, period: int) -> None:
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

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
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

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
        self._forces = [0.0] * len(joints)

    def take(self, command: JointCommand, rows: Rows, period: int) -> None:
        """Take in torques, cut at the joints' limits."""
        for place, source in rows:
            torque = command.values[source]
            self._velocities[place] = math.copysign(_UNREACHED_VELOCITY, torque)
            self._forces[place] = min(abs(torque), self._efforts[place])
        self._changed = True


class VelocityMotor(_Motors):
    """Mode velocity: a motor that holds a velocity with limited torque."""

    def take(self, command: JointCommand, rows: Rows, period: int) -> None:
        """Take in velocities, cut at the joints' limits."""
        for place, source in rows:
            limit = self.joints[place].max_velocity or math.inf
            self._velocities[place] = _clip(command.values[source], limit)
            self._take_limit(command, place, source)
        self._changed = True


class PositionMotor(_Motors):
    """Mode position: a motor that follows a target with limited torque and velocity.

    A target with a feed-forward velocity moves on at it until the next command is due, as in a
    drive that is given position, velocity and time. A target that stood still in between would
    make the joint follow stairs, and lag behind.
    """

    def __init__(self, client: int, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(client, joints, substep_s)
        self._commanded = [joint.start for joint in joints]
        self._age = [0] * len(joints)
        self._moving: dict[int, int] = {}

    def take(self, command: JointCommand, rows: Rows, period: int) -> None:
        """Take in targets and feed-forward velocities."""
        ahead = command.velocity
        for place, source in rows:
            self._aim(place, command.values[source])
            self._take_limit(command, place, source)
            if ahead is not None and ahead[source] != 0.0:
                self._velocities[place] = ahead[source]
                self._moving[place] = period
        self._changed = True

    def _aim(self, place: int, position: float) -> None:
        """Have a joint stand still at a position [rad]."""
        self._commanded[place], self._velocities[place] = position, 0.0
        self._age[place] = 0
        self._moving.pop(place, None)

    def jumped(self, place: int, position: float) -> None:
        """Hold the new position, instead of pulling the joint back."""
        self._aim(place, position)
        self._changed = True

    def brake(self, place: int, position: float) -> None:
        """Hold the joint where it is."""
        super().brake(place, position)
        self._aim(place, position)

    def targets(self) -> list[float] | None:
        """Return where the joints shall be now, cut at their stops [rad]."""
        return [self._target(place) for place in range(len(self.joints))]

    def _target(self, place: int) -> float:
        joint = self.joints[place]
        way = self._velocities[place] * self._age[place] * self._substep_s
        return min(max(self._commanded[place] + way, joint.lower), joint.upper)

    def before_substep(self) -> None:
        """Set the motors that a command has changed, and move the targets that move."""
        super().before_substep()
        for place, period in list(self._moving.items()):
            if self._age[place] >= period:
                self._aim(place, self._target(place))
            self._set_one(place)
            self._age[place] += 1 if place in self._moving else 0

    def _set(self) -> None:
        for place in range(len(self.joints)):
            self._set_one(place)

    def _set_one(self, place: int) -> None:
        joint = self.joints[place]
        limit = {"maxVelocity": joint.max_velocity} if joint.max_velocity > 0 else {}
        bullet.setJointMotorControl2(
            self._body,
            joint.index,
            bullet.POSITION_CONTROL,
            targetPosition=self._target(place),
            targetVelocity=self._velocities[place],
            force=self._forces[place],
            physicsClientId=self._client,
            **limit,
        )


def _clip(value: float, limit: float) -> float:
    return -limit if value < -limit else min(value, limit)


def make_drives(client: int, joints: Iterable[Joint], substep_s: float) -> list[Drive]:
    """Return one drive per body, mode and actuation, so that each is one call a substep.

    substep_s: length of a physics substep [s].
    """

    def key(joint: Joint) -> tuple[int, str, str]:
        return (joint.body, joint.told_mode, joint.actuation)

    groups = [list(group) for _, group in groupby(sorted(joints, key=key), key)]
    return [_class_for(group[0])(client, group, substep_s) for group in groups]


def _class_for(joint: Joint) -> type[Drive]:
    torque = DirectTorque if joint.actuation == "direct" else VelocityForce
    # Nothing drives a joint of mode teleport, which is put where a command says, or a passive one.
    classes: dict[str, type[Drive]] = {
        "torque": torque,
        "velocity": VelocityMotor,
        "position": PositionMotor,
        "teleport": Drive,
        "passive": Drive,
    }
    return classes[joint.told_mode]
