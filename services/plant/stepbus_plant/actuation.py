"""How joint commands become forces: one small class per mode, one seam."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import pybullet as bullet

from stepbus.settings import nearest
from stepbus_schemas import JointCommand
from stepbus_schemas.messages import JointMode

from .errors import CommandError
from .physics import Joint, Physics

# Any velocity that is never reached: the motor then always pulls with its maximum force.
_UNREACHED_VELOCITY = 1e4


class Drive(Protocol):
    """Carries out one mode for joints of one body, all of that mode."""

    def apply(self, command: JointCommand, pick: Sequence[int]) -> None:
        """Take in a command; `pick` says where these joints stand in its vectors."""

    def before_substep(self) -> None:
        """Do what has to be done anew before each physics substep."""

    def efforts(self) -> list[float] | None:
        """Return the torques applied [N·m], where the physics engine cannot be asked for them."""


class _Group:
    """Joints of one body that are driven alike."""

    def __init__(self, physics: Physics, joints: Sequence[Joint]) -> None:
        self._physics = physics
        self._client = physics.client
        self._joints = list(joints)
        self._body = joints[0].body
        self._indices = [joint.index for joint in joints]
        self._effort = [joint.effort for joint in joints]

    def before_substep(self) -> None:
        """Nothing: motors keep their targets."""

    def efforts(self) -> list[float] | None:
        """Return None: the engine knows."""
        return None

    def _limits(self, command: JointCommand, pick: Sequence[int]) -> list[float]:
        """Return the largest torque of each joint: its own, or the command's if that is less."""
        if command.effort_limit is None:
            return self._effort
        wanted = [command.effort_limit[i] for i in pick]
        return [min(max(w, 0.0), own) for w, own in zip(wanted, self._effort, strict=True)]


class DirectTorque(_Group):
    """Mode torque: the engine applies the torque itself."""

    def __init__(self, physics: Physics, joints: Sequence[Joint]) -> None:
        super().__init__(physics, joints)
        self._forces = [0.0] * len(joints)
        self._floor = [-limit for limit in self._effort]

    def apply(self, command: JointCommand, pick: Sequence[int]) -> None:
        """Take in torques, cut at the joints' limits."""
        values = command.values
        self._forces = [
            min(max(values[i], low), high)
            for i, low, high in zip(pick, self._floor, self._effort, strict=True)
        ]

    def before_substep(self) -> None:
        """Apply the torques; the engine forgets them after every substep."""
        bullet.setJointMotorControlArray(
            self._body,
            self._indices,
            bullet.TORQUE_CONTROL,
            forces=self._forces,
            physicsClientId=self._client,
        )

    def efforts(self) -> list[float] | None:
        """Return the torques applied [N·m]; the engine does not report them in this mode."""
        return self._forces


class VelocityForce(_Group):
    """Mode torque as simulators without a torque input know it.

    A motor that shall reach an unreachable velocity with at most the force |τ| applies τ.
    """

    def apply(self, command: JointCommand, pick: Sequence[int]) -> None:
        """Take in torques, cut at the joints' limits."""
        wanted = [command.values[i] for i in pick]
        bullet.setJointMotorControlArray(
            self._body,
            self._indices,
            bullet.VELOCITY_CONTROL,
            targetVelocities=[math.copysign(_UNREACHED_VELOCITY, tau) for tau in wanted],
            forces=[min(abs(t), high) for t, high in zip(wanted, self._effort, strict=True)],
            physicsClientId=self._client,
        )


class VelocityMotor(_Group):
    """Mode velocity: a motor that holds a velocity with limited torque."""

    def __init__(self, physics: Physics, joints: Sequence[Joint]) -> None:
        super().__init__(physics, joints)
        self._drive([0.0] * len(joints), self._effort)

    def apply(self, command: JointCommand, pick: Sequence[int]) -> None:
        """Take in velocities, cut at the joints' limits."""
        wanted = [
            _clip(command.values[i], joint.max_velocity)
            for i, joint in zip(pick, self._joints, strict=True)
        ]
        self._drive(wanted, self._limits(command, pick))

    def _drive(self, velocities: list[float], forces: list[float]) -> None:
        bullet.setJointMotorControlArray(
            self._body,
            self._indices,
            bullet.VELOCITY_CONTROL,
            targetVelocities=velocities,
            forces=forces,
            physicsClientId=self._client,
        )


class PositionMotor(_Group):
    """Mode position: a motor that follows a target with limited torque and velocity.

    targets: the newest ones, cut at the joints' stops [rad].
    """

    def __init__(self, physics: Physics, joints: Sequence[Joint]) -> None:
        super().__init__(physics, joints)
        self._drive([joint.start for joint in joints], [0.0] * len(joints), self._effort)

    def apply(self, command: JointCommand, pick: Sequence[int]) -> None:
        """Take in targets and feed-forward velocities, without which the joint lags behind."""
        targets = [
            min(max(command.values[i], joint.lower), joint.upper)
            for i, joint in zip(pick, self._joints, strict=True)
        ]
        ahead = [0.0 if command.velocity is None else command.velocity[i] for i in pick]
        self._drive(targets, ahead, self._limits(command, pick))

    def _drive(self, targets: list[float], ahead: list[float], forces: list[float]) -> None:
        self.targets = targets
        for joint, target, velocity, force in zip(
            self._joints, targets, ahead, forces, strict=True
        ):
            limit = {"maxVelocity": joint.max_velocity} if joint.max_velocity > 0 else {}
            bullet.setJointMotorControl2(
                joint.body,
                joint.index,
                bullet.POSITION_CONTROL,
                targetPosition=target,
                targetVelocity=velocity,
                force=force,
                physicsClientId=self._client,
                **limit,
            )


class NoMotor(_Group):
    """Mode teleport: nothing drives the joint; it is put where a command says."""

    def apply(self, command: JointCommand, pick: Sequence[int]) -> None:
        """Nothing: teleporting is done for every mode alike."""


def _clip(value: float, limit: float) -> float:
    """Return a value cut at ± a limit; a limit of 0 means none, as in a URDF."""
    return min(max(value, -limit), limit) if limit > 0 else value


def make_drive(physics: Physics, joints: Sequence[Joint]) -> Drive:
    """Return the drive for joints of one body with the same mode and actuation."""
    mode, actuation = joints[0].mode, joints[0].actuation
    if mode == "torque":
        return (DirectTorque if actuation == "direct" else VelocityForce)(physics, joints)
    if mode == "velocity":
        return VelocityMotor(physics, joints)
    return (PositionMotor if mode == "position" else NoMotor)(physics, joints)


class Commander:
    """Takes the commands of one input to the joints they are for.

    port: its name, for messages. names: whose values its vectors hold, in their order.
    Raises CommandError when a name is unknown or stands there twice.
    """

    def __init__(
        self, port: str, names: Sequence[str], physics: Physics, drives: Sequence[Driven]
    ) -> None:
        joints = {joint.name: joint for joint in physics.joints}
        for name in names:
            if name not in joints:
                raise CommandError(f"input {port!r}: joint {name!r}: {nearest(name, joints)}")
            if names.count(name) > 1:
                raise CommandError(f"input {port!r}: joint {name!r} stands there twice")
        self._port = port
        self._physics = physics
        self._joints = [joints[name] for name in names]
        self._drives = [
            (driven.drive, pick) for driven in drives if (pick := driven.pick(names)) is not None
        ]
        partly = [d for d in drives if d.pick(names) is None and d.touches(names)]
        if partly:
            missing = [name for name in partly[0].names if name not in names]
            raise CommandError(
                f"input {port!r}: joints of one body and mode are commanded together; "
                f"{', '.join(missing)} missing"
            )

    def apply(self, command: JointCommand) -> None:
        """Carry out a command from now on.

        Raises CommandError for a wrong length, a value that is no number, or a wrong mode.
        """
        self._check(command)
        if command.mode == "teleport":
            self._teleport(command)
            return
        for drive, pick in self._drives:
            drive.apply(command, pick)

    def _check(self, command: JointCommand) -> None:
        for field in ("values", "velocity", "effort_limit"):
            vector = getattr(command, field)
            if vector is not None:
                self._check_vector(field, vector)
        mode: JointMode = command.mode
        if mode != "teleport":
            for joint in self._joints:
                if joint.mode != mode:
                    raise CommandError(
                        f"input {self._port!r}: joint {joint.name} takes mode {joint.mode}, the "
                        f"command has mode {mode}; change one of them (world: joints, mode)"
                    )

    def _check_vector(self, field: str, vector: Sequence[float]) -> None:
        if len(vector) != len(self._joints):
            raise CommandError(
                f"input {self._port!r}: {field} has {len(vector)} values for "
                f"{len(self._joints)} joints ({', '.join(j.name for j in self._joints)})"
            )
        if not math.isfinite(sum(vector)):
            for joint, value in zip(self._joints, vector, strict=True):
                if not math.isfinite(value):
                    raise CommandError(
                        f"input {self._port!r}: {field} of joint {joint.name} is {value}"
                    )

    def _teleport(self, command: JointCommand) -> None:
        velocities = command.velocity or [0.0] * len(self._joints)
        for joint, position, velocity in zip(self._joints, command.values, velocities, strict=True):
            if not joint.lower <= position <= joint.upper:
                raise CommandError(
                    f"input {self._port!r}: joint {joint.name} cannot be teleported to "
                    f"{position}; its limits are [{joint.lower}, {joint.upper}]"
                )
            self._physics.put(joint, position, velocity)


class Driven:
    """A drive and the names of its joints, in its order."""

    def __init__(self, drive: Drive, names: Sequence[str]) -> None:
        self.drive = drive
        self.names = list(names)

    def pick(self, given: Sequence[str]) -> list[int] | None:
        """Return where its joints stand among given names; None when one is missing."""
        if any(name not in given for name in self.names):
            return None
        return [list(given).index(name) for name in self.names]

    def touches(self, given: Sequence[str]) -> bool:
        """Return whether any of its joints is among given names."""
        return any(name in given for name in self.names)
