"""Drives turn joint commands into forces: one class per mode."""

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, ClassVar

from stepbus_plant.engine import Engine, Goal
from stepbus_plant.joint import Joint
from stepbus_plant.memory import Remembers
from stepbus_plant.physics import Physics
from stepbus_schemas import JointCommand

# A velocity the motor never reaches, so that it always applies its maximum force.
_UNREACHED_VELOCITY = 1e4

Indices = Sequence[tuple[int, int]]
"""Pairs of a joint's index in its drive and in the vectors of a command."""


class Drive(Remembers):
    """Joints of one body with the same mode and actuation, and the latest target of each.

    This class itself drives nothing: a passive joint, and one of mode teleport, which jumps to each
    commanded position. joints: each keeps its target until a command names it again, even if
    another input commands the drive's other joints. substep_s: length of a physics substep [s].
    """

    def __init__(self, engine: Engine, joints: Sequence[Joint], substep_s: float) -> None:
        self.joints = list(joints)
        self._engine = engine
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

    def before_substep(self) -> None:
        """Pass new targets to the physics engine."""

    def followed(self, index: int, position: float, dt: float) -> tuple[float, float]:
        """Return position and velocity of a joint after dt [s], if it follows at once [rad, rad/s].

        position: of now. What nothing drives stays where it is.
        """
        return position, 0.0


class DirectTorque(Drive):
    """Mode torque: the engine applies the torque directly, and does not report it.

    applied: the latest torque of each joint [N·m].
    """

    remembers = ("_wanted", "applied", "_braked")

    def __init__(self, engine: Engine, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(engine, joints, substep_s)
        self._wanted = [0.0] * len(joints)
        self.applied = self._wanted.copy()
        self._braked: list[int] = []

    def command(self, command: JointCommand, indices: Indices, period: int) -> None:
        """Set torques, saturated at the joints' limits; this releases the brake."""
        values, wanted, efforts = command.values, self._wanted, self._efforts
        for index, source in indices:
            value, limit = values[source], efforts[index]
            wanted[index] = value if -limit <= value <= limit else math.copysign(limit, value)
            if index in self._braked:
                self._braked.remove(index)
                self._resist(index, self.joints[index].friction)

    def brake(self, index: int, position: float) -> None:
        """Hold the joint with the engine's motor, whose torque is not reported."""
        self._wanted[index] = 0.0
        if index not in self._braked:
            self._braked.append(index)
        self._resist(index, self._efforts[index])

    def restore(self, saved: Any) -> None:
        """Take a state from `save`, and set the engine's motors accordingly."""
        super().restore(saved)
        for index in self._braked:
            self._resist(index, self._efforts[index])

    def _resist(self, index: int, torque: float) -> None:
        self._engine.turn(self._body, [self._indices[index]], [0.0], [torque])

    def before_substep(self) -> None:
        """Apply the torques; the engine forgets them after every substep."""
        self.applied = self._wanted.copy()
        self._engine.push(self._body, self._indices, self.applied)


class VelocityMotor(Drive):
    """Mode velocity: a motor of the engine that tracks a velocity with limited torque.

    It keeps its targets from one substep to the next. _velocities: targets [rad/s]. _forces: torque
    limits [N·m].
    """

    remembers: ClassVar[tuple[str, ...]] = ("_velocities", "_forces")

    def __init__(self, engine: Engine, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(engine, joints, substep_s)
        self._velocities = [0.0] * len(joints)
        self._forces = self._efforts.copy()
        self._changed = True

    def command(self, command: JointCommand, indices: Indices, period: int) -> None:
        """Set targets and torque limits."""
        for index, source in indices:
            own, limit = self._efforts[index], command.effort_limit
            self._forces[index] = own if limit is None else min(max(limit[source], 0.0), own)
            self._take(index, command, source, period)
        self._changed = True

    def _take(self, index: int, command: JointCommand, source: int, period: int) -> None:
        """Set the target of one joint; source: its index in the command."""
        limit = self.joints[index].max_velocity or math.inf
        self._velocities[index] = max(min(command.values[source], limit), -limit)

    def followed(self, index: int, position: float, dt: float) -> tuple[float, float]:
        """Return where its velocity takes a joint, no further than to its stops."""
        velocity = self._velocities[index]
        return self.joints[index].within_stops(position + velocity * dt), velocity

    def restore(self, saved: Any) -> None:
        """Take a state from `save`, and set the engine's motors accordingly."""
        super().restore(saved)
        self._changed = True

    def brake(self, index: int, position: float) -> None:
        """Hold the joint with its full torque."""
        self._velocities[index], self._forces[index] = 0.0, self._efforts[index]
        self._changed = True

    def before_substep(self) -> None:
        """Set the motors if a command has changed them."""
        if self._changed:
            self._changed = False
            self._engine.turn(self._body, self._indices, self._velocities, self._forces)


class VelocityForce(VelocityMotor):
    """Mode torque for simulators without a torque input.

    A motor with an unreachable target velocity and the force limit |τ| applies τ.
    """

    def __init__(self, engine: Engine, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(engine, joints, substep_s)
        self._forces = [0.0] * len(joints)

    def _take(self, index: int, command: JointCommand, source: int, period: int) -> None:
        torque = command.values[source]
        self._velocities[index] = math.copysign(_UNREACHED_VELOCITY, torque)
        self._forces[index] = min(abs(torque), self._efforts[index])


class PositionMotor(VelocityMotor):
    """Mode position: a motor that tracks a target with limited torque and velocity.

    A target with a feed-forward velocity keeps moving until the next command is due, as in a drive
    commanded with position, velocity and time. With a constant target the joint would track a
    staircase, and lag behind.
    """

    remembers = (*VelocityMotor.remembers, "_commanded", "_age", "_moving")

    def __init__(self, engine: Engine, joints: Sequence[Joint], substep_s: float) -> None:
        super().__init__(engine, joints, substep_s)
        self._commanded = [joint.start for joint in joints]
        self._age = [0] * len(joints)
        self._moving: dict[int, int] = {}

    def _take(self, index: int, command: JointCommand, source: int, period: int) -> None:
        """Set target and feed-forward velocity."""
        self._hold(index, command.values[source])
        if command.velocity is not None and command.velocity[source] != 0.0:
            self._velocities[index] = command.velocity[source]
            self._moving[index] = period

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
        return self.target(index), self._velocities[index]

    def target(self, index: int) -> float:
        """Return the current target of a joint, limited to its stops [rad]."""
        travel = self._velocities[index] * self._age[index] * self._substep_s
        return self.joints[index].within_stops(self._commanded[index] + travel)

    def before_substep(self) -> None:
        """Set the motors if a command has changed them, and advance the moving targets."""
        indices = range(len(self.joints)) if self._changed else list(self._moving)
        self._changed = False
        for index in indices:
            if self._age[index] >= self._moving.get(index, math.inf):
                self._hold(index, self.target(index))
            joint, velocity = self.joints[index], self._velocities[index]
            goal = Goal(self.target(index), velocity, self._forces[index], joint.max_velocity)
            self._engine.bring(self._body, joint.index, goal)
            self._age[index] += index in self._moving


_CLASSES: Mapping[tuple[str, str], type[Drive]] = {
    ("torque", "direct"): DirectTorque,
    ("torque", "velocity_force"): VelocityForce,
    ("velocity", ""): VelocityMotor,
    ("position", ""): PositionMotor,
}
"""Mode and, of mode torque, actuation → class; of any other: `Drive`."""


class Warnings(Remembers):
    """Collects warnings about commands until the plant has reported them.

    Each cause is reported once per subject: a controller that commands the impossible does so at
    every step. reported: (subject, cause). pending: one sentence each.
    """

    remembers = ("reported", "pending")
    reported: list[tuple[str, str]]

    def __init__(self) -> None:
        self.reported = []
        self.pending: list[str] = []

    def add(self, subject: str, cause: str, text: str) -> None:
        """Add a warning, unless this cause has been reported for this subject."""
        if (subject, cause) not in self.reported:
            self.reported.append((subject, cause))
            self.pending.append(f"{subject}: {text}")

    def check(self, joints: Sequence[Joint], command: JointCommand) -> None:
        """Warn about each part of a command that cannot take effect; its vectors fit the joints."""
        for index, joint in enumerate(joints):
            for cause, text in joint.without_effect(command, index):
                self.add(f"joint {joint.name}", cause, text)


class Motors(Remembers):
    """The drives of a world: one per body, mode and actuation, for one engine call per substep.

    step_ns, period_ns: length of a physics substep, and of the plant's step [ns]. drive_of: joint →
    its drive, and its index in that. owners: joint → the input that drives it. warnings: about
    commands. All commanders share these.
    """

    remembers, parts = ("owners",), ("drives", "warnings")

    def __init__(self, physics: Physics, step_ns: int, period_ns: int) -> None:
        def key(joint: Joint) -> tuple[int, str, str]:
            return (joint.body, joint.effective_mode, joint.actuation)

        self.physics = physics
        self.step_ns, self.period_ns = step_ns, period_ns
        groups = groupby(sorted(physics.joints.values(), key=key), key)
        self.drives = [
            _CLASSES.get((mode, actuation if mode == "torque" else ""), Drive)(
                physics.engine, list(joints), step_ns * 1e-9
            )
            for (_, mode, actuation), joints in groups
        ]
        self.drive_of = {
            joint.name: (drive, index)
            for drive in self.drives
            for index, joint in enumerate(drive.joints)
        }
        self.owners: dict[str, str] = {}
        self.warnings = Warnings()
