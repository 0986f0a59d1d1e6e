"""Takes the commands of one input to the joints they are for, and refuses what cannot work."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NoReturn

from stepbus_participant.settings import nearest
from stepbus_plant.errors import CommandError
from stepbus_plant.physics.engine import Physics
from stepbus_plant.physics.joint import Joint
from stepbus_schemas import JointCommand, WiringError
from stepbus_schemas.messages import JointMode

from .drives import Drive
from .warnings import Complaints, degrees_hint

_EXTRAS = {
    "torque": (),
    "velocity": ("effort_limit",),
    "position": ("velocity", "effort_limit"),
    "teleport": ("velocity",),
    "brake": (),
}
"""The vectors that a mode takes beside `values`."""


class Commander:
    """Carries out the commands of one input; there may be several, one for each arm.

    port: its name, for messages. names: whose values its vectors hold, in their order. period:
    substeps from one command to the next. owners: joint → the input that drives it; complaints:
    what commands ask for in vain; both are shared by all commanders of a plant.
    Raises WiringError when names are unknown, fixed, or stand there twice.
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
        complaints: Complaints,
    ) -> None:
        self._port = port
        self._period = period
        self._complaints = complaints
        self._physics = physics
        self._owners = owners
        self._mode: JointMode | None = None
        joints = {joint.name: joint for joint in physics.joints}
        self._check_names(names, joints)
        self._joints = [joints[name] for name in names]
        at = {joint.name: (d, i) for d in drives for i, joint in enumerate(d.joints)}
        self._at = [at[name] for name in names]
        self._rows = [
            (drive, [(i, source) for source, (d, i) in enumerate(self._at) if d is drive])
            for drive in dict.fromkeys(drive for drive, _ in self._at)
        ]

    def _check_names(self, names: Sequence[str], known: dict[str, Joint]) -> None:
        mistakes = [
            f"joint {n!r} is fixed in its model; no command moves it"
            if n in self._physics.fixed
            else f"joint {n!r} is unknown; {nearest(n, known)}"
            for n in names
            if n not in known
        ]
        mistakes += [
            f"joint {n!r} stands there twice" for n in dict.fromkeys(names) if names.count(n) > 1
        ]
        if mistakes:
            raise WiringError("\n".join(f"input {self._port!r}: {text}" for text in mistakes))

    def apply(self, command: JointCommand) -> None:
        """Carry out a command from now on; nothing of it is done when any of it is refused.

        Raises CommandError for a vector of the wrong length or one that the mode does not take, a
        value that is no number, a mode that a joint does not take, a teleport beyond a stop, and a
        joint that another input drives. Every joint takes mode brake, whatever its own.
        """
        self._check_vectors(command)
        if command.mode == "teleport":
            self._teleport(command)
            return
        if command.mode == "brake":
            self._brake()
            return
        if command.mode != self._mode:
            self._own(command.mode)
            if command.mode == "position":
                self._complaints.check_start(self._joints, self._positions(), command.values)
        self._complaints.check(self._joints, command)
        for drive, rows in self._rows:
            drive.take(command, rows, self._period)

    def before_step(self) -> None:
        """Do nothing: the drives carry a command on."""

    def _check_vectors(self, command: JointCommand) -> None:
        self._check_vector("values", command.values)
        for field, vector in (
            ("velocity", command.velocity),
            ("effort_limit", command.effort_limit),
        ):
            if vector is not None:
                if field not in _EXTRAS[command.mode]:
                    self._refuse(f"{field} has no meaning in mode {command.mode}; leave it out")
                self._check_vector(field, vector)
        if command.effort_limit and min(command.effort_limit) < 0:
            self._refuse(f"effort_limit {min(command.effort_limit)} is negative")

    def _check_vector(self, field: str, vector: Sequence[float]) -> None:
        if len(vector) != len(self._joints):
            self._refuse(
                f"{field} has {len(vector)} values for {len(self._joints)} joints "
                f"({', '.join(joint.name for joint in self._joints)})"
            )
        if not math.isfinite(sum(vector)):
            for joint, value in zip(self._joints, vector, strict=True):
                if not math.isfinite(value):
                    self._refuse(f"{field} of joint {joint.name} is {value}, not a finite number")

    def _own(self, mode: JointMode) -> None:
        """Check that the joints take this mode and that nobody else drives them."""
        for joint in self._joints:
            if joint.motor and joint.mode != mode:
                self._refuse(
                    f"joint {joint.name} takes mode {joint.mode}, the command has mode {mode}; "
                    "change one of them (world file: mode)"
                )
            owner = self._owners.setdefault(joint.name, self._port)
            if owner != self._port:
                self._refuse(f"joint {joint.name} is already driven by input {owner!r}")
        self._mode = mode

    def _brake(self) -> None:
        """Hold every joint where it is; what is held already is not moved on."""
        if self._mode == "brake":
            return
        for (drive, place), position in zip(self._at, self._positions(), strict=True):
            drive.brake(place, position)
        self._mode = "brake"

    def _positions(self) -> list[float]:
        """Return where the joints are now [rad]."""
        read = self._physics.read
        return [read(joint.body, [joint.index])[0][0] for joint in self._joints]

    def _teleport(self, command: JointCommand) -> None:
        velocities = command.velocity or [0.0] * len(self._joints)
        for joint, position in zip(self._joints, command.values, strict=True):
            if not joint.lower <= position <= joint.upper:
                self._refuse(
                    f"joint {joint.name} cannot be teleported to {position}; its limits are "
                    f"[{joint.lower}, {joint.upper}]{degrees_hint(joint, position)}"
                )
        rows = zip(self._joints, self._at, command.values, velocities, strict=True)
        for joint, (drive, place), position, velocity in rows:
            self._physics.put(joint, position, velocity)
            drive.jumped(place, position)

    def _refuse(self, text: str) -> NoReturn:
        raise CommandError(f"input {self._port!r}: {text}")
