"""Checks the commands of one input and passes them to the drives of their joints."""

import math
from collections.abc import Sequence
from typing import NoReturn

from stepbus_participant import suggest
from stepbus_plant.drives import Drive, locate_joints
from stepbus_plant.engine import Physics
from stepbus_plant.errors import CommandError
from stepbus_plant.joint import Joint
from stepbus_plant.sensing import Warnings, degrees_hint
from stepbus_schemas import JointCommand, JointMode, WiringError

_EXTRAS = {
    "torque": (),
    "velocity": ("effort_limit",),
    "position": ("velocity", "effort_limit"),
    "teleport": ("velocity",),
    "brake": (),
}
"""Mode → the vectors it accepts beside `values`."""


class Commander:
    """Executes the commands of one input; there may be several, one for each arm.

    port: name of the input, for messages. names: joints of the vectors, in order. period: substeps
    between two commands. owners: joint → the input that drives it. warnings: about commands. All
    commanders of a plant share the last two. mode: of the last command.
    Raises WiringError for names that are unknown, fixed or duplicate.
    """

    def __init__(
        self,
        port: str,
        names: Sequence[str],
        *,
        physics: Physics,
        drives: Sequence[Drive],
        period: int,
        owners: dict[str, str],
        warnings: Warnings,
    ) -> None:
        self._port = port
        self._period = period
        self._warnings = warnings
        self._physics = physics
        self._owners = owners
        self.mode: JointMode | None = None
        joints = {joint.name: joint for joint in physics.joints}
        self._check_names(names, joints)
        self._joints = [joints[name] for name in names]
        by_name = locate_joints(drives)
        self._drives = [by_name[name] for name in names]
        self._indices = [
            (drive, [(i, source) for source, (d, i) in enumerate(self._drives) if d is drive])
            for drive in dict.fromkeys(drive for drive, _ in self._drives)
        ]

    def _check_names(self, names: Sequence[str], known: dict[str, Joint]) -> None:
        mistakes = [
            f"joint {n!r} is fixed in its model; no command moves it"
            if n in self._physics.fixed
            else f"joint {n!r} is unknown{suggest(n, known)}"
            for n in names
            if n not in known
        ]
        mistakes += [
            f"joint {n!r} is listed twice" for n in dict.fromkeys(names) if names.count(n) > 1
        ]
        if mistakes:
            raise WiringError("\n".join(f"input {self._port!r}: {text}" for text in mistakes))

    def apply(self, command: JointCommand) -> None:
        """Execute a command from now on; an invalid one has no effect at all.

        Raises CommandError for a vector of the wrong length or one that the mode does not accept, a
        value that is not finite, a mode that a joint does not accept, a teleport beyond a stop, and
        a joint that another input drives. Every joint accepts mode brake.
        """
        self._check_vectors(command)
        if command.mode == "teleport":
            self._teleport(command)
            return
        if command.mode == "brake":
            self._brake()
            return
        if command.mode != self.mode:
            self._own(command.mode)
            if command.mode == "position":
                self._warnings.check_start(self._joints, self._positions(), command.values)
        self._warnings.check(self._joints, command)
        for drive, indices in self._indices:
            drive.command(command, indices, self._period)

    def before_step(self) -> None:
        """Do nothing: the drives keep executing the latest command."""

    def _check_vectors(self, command: JointCommand) -> None:
        self._check_vector("values", command.values)
        for field, vector in (
            ("velocity", command.velocity),
            ("effort_limit", command.effort_limit),
        ):
            if vector is not None:
                if field not in _EXTRAS[command.mode]:
                    self._reject(f"mode {command.mode} does not use {field}; leave it out")
                self._check_vector(field, vector)
        if command.effort_limit and min(command.effort_limit) < 0:
            self._reject(f"effort_limit {min(command.effort_limit)} is negative")

    def _check_vector(self, field: str, vector: Sequence[float]) -> None:
        if len(vector) != len(self._joints):
            self._reject(
                f"{field} has {len(vector)} values for {len(self._joints)} joints "
                f"({', '.join(joint.name for joint in self._joints)})"
            )
        if not math.isfinite(sum(vector)):
            for joint, value in zip(self._joints, vector, strict=True):
                if not math.isfinite(value):
                    self._reject(f"{field} of joint {joint.name} is {value}, not a finite number")

    def _own(self, mode: JointMode) -> None:
        """Check that the joints accept this mode and that no other input drives them."""
        for joint in self._joints:
            if joint.motor and joint.mode != mode:
                self._reject(
                    f"joint {joint.name} has mode {joint.mode}, the command has mode {mode}; "
                    "change one of them (world file: mode)"
                )
            owner = self._owners.setdefault(joint.name, self._port)
            if owner != self._port:
                self._reject(f"joint {joint.name} is already driven by input {owner!r}")
        self.mode = mode

    def stop(self) -> None:
        """Hold every joint where it is, until the next command."""
        self._brake()

    def _brake(self) -> None:
        """Hold every joint at its current position; a repeated brake keeps the first one."""
        if self.mode == "brake":
            return
        for (drive, index), position in zip(self._drives, self._positions(), strict=True):
            drive.brake(index, position)
        self.mode = "brake"

    def _positions(self) -> list[float]:
        """Return the current joint positions [rad]."""
        read = self._physics.read
        return [read(joint.body, [joint.index])[0][0] for joint in self._joints]

    def _teleport(self, command: JointCommand) -> None:
        velocities = command.velocity or [0.0] * len(self._joints)
        for joint, position in zip(self._joints, command.values, strict=True):
            if not joint.lower <= position <= joint.upper:
                self._reject(
                    f"joint {joint.name} cannot be teleported to {position}; its limits are "
                    f"[{joint.lower}, {joint.upper}]{degrees_hint(joint, position)}"
                )
        states = zip(self._joints, self._drives, command.values, velocities, strict=True)
        for joint, (drive, index), position, velocity in states:
            self._physics.teleport(joint, position, velocity)
            drive.teleport(index, position)

    def _reject(self, text: str) -> NoReturn:
        raise CommandError(self._port, text)
