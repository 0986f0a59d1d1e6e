"""Checks the commands of one input and passes them to the drives of their joints."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar, NoReturn

import msgspec

from stepbus_participant import InvalidInput
from stepbus_plant.drives import Motors
from stepbus_schemas import GripperCommand, JointCommand, JointMode, WiringError

_EXTRAS = {
    "torque": (),
    "velocity": ("effort_limit",),
    "position": ("velocity", "effort_limit"),
    "teleport": ("velocity",),
    "brake": (),
}
"""Mode → the vectors it accepts beside `values`."""


class CommandError(InvalidInput, ValueError):
    """An invalid command; its sender is to blame."""


class Ramp(msgspec.Struct):
    """Brings joints to rest together.

    positions, velocities: of now [rad, rad/s]. left: until they are at rest [s].
    """

    positions: list[float]
    velocities: list[float]
    left: float

    def after(self, seconds: float) -> tuple[list[float], list[float]] | None:
        """Return positions and velocities some time later; None: all are at rest."""
        if self.left <= seconds:
            return None
        share = 1.0 - seconds / self.left
        self.left -= seconds
        before, self.velocities = self.velocities, [v * share for v in self.velocities]
        means = ((one + two) / 2 for one, two in zip(before, self.velocities, strict=True))
        self.positions = [p + v * seconds for p, v in zip(self.positions, means, strict=True)]
        return self.positions, self.velocities


class Commander:
    """Executes the commands of one input; there may be several, one for each arm.

    port: name of the input, for messages. names: joints of the vectors, in order. period_ns:
    between two commands [ns]; default: the plant's step. mode: of the last command.
    Raises WiringError for names that are unknown, fixed or duplicate.
    """

    obeys_stop: ClassVar[bool] = True
    """Whether an emergency stop brakes its joints."""

    def __init__(
        self, port: str, names: Sequence[str], motors: Motors, period_ns: int | None = None
    ) -> None:
        self._port = port
        self._period = (period_ns or motors.period_ns) // motors.step_ns
        self._motors = motors
        self._physics = motors.physics
        self._warnings = motors.warnings
        self.mode: JointMode | None = None
        self.ramp: Ramp | None = None
        """How the joints come to rest; None: they do not, or are."""
        self.held: GripperCommand | None = None
        """What each step executes anew."""
        self._check_names(names)
        self._joints = [self._physics.joints[name] for name in names]
        self._drives = [motors.drive_of[name] for name in names]
        self._indices = [
            (drive, [(i, source) for source, (d, i) in enumerate(self._drives) if d is drive])
            for drive in dict.fromkeys(drive for drive, _ in self._drives)
        ]

    def _check_names(self, names: Sequence[str]) -> None:
        unmoved = "; no command moves it"
        mistakes = [
            f"joint {n!r} {text}{unmoved if n in self._physics.fixed else ''}"
            for n in names
            if (text := self._physics.lacks_joint(n))
        ]
        mistakes += [
            f"joint {n!r} is listed twice" for n in dict.fromkeys(names) if names.count(n) > 1
        ]
        if mistakes:
            raise WiringError("\n".join(mistakes))

    def apply(self, command: Any) -> None:
        """Execute a JointCommand from now on; an invalid one has no effect at all.

        Raises CommandError for a vector of the wrong length or one that the mode does not accept, a
        value that is not finite, a mode that a joint does not accept, a teleport beyond a stop, and
        a joint that another input drives. Every joint accepts mode brake.
        """
        self.ramp = None
        self.execute(command)

    def before_step(self) -> None:
        """Prepare a communication step, with or without a new command: the drives keep theirs."""
        if self.ramp is None:
            return
        state = self.ramp.after(self._motors.period_ns * 1e-9)
        if state is None:
            self.stop()
            return
        positions, velocities = state
        if self.mode == "velocity":
            self.execute(JointCommand(mode="velocity", values=velocities))
        else:
            self.execute(JointCommand(mode="position", values=positions, velocity=velocities))

    def stop(self) -> None:
        """Hold every joint at its current position; a repeated brake keeps the first one."""
        self.ramp = None
        if self.mode == "brake":
            return
        for (drive, index), position in zip(self._drives, self._positions(), strict=True):
            drive.brake(index, position)
        self.mode = "brake"

    def halt(self) -> None:
        """Come to rest in an emergency stop; `before_step` is called all the while."""
        brakes = [joint.brake for joint in self._joints if joint.brake is not None]
        if len(brakes) < len(self._joints) or self.mode not in ("velocity", "position"):
            self.stop()
            return
        states = [self._physics.state(joint) for joint in self._joints]
        positions, velocities = map(list, zip(*states, strict=True))
        # Each no harder than it may brake.
        left = max(abs(v) / most for v, most in zip(velocities, brakes, strict=True))
        self.ramp = Ramp(positions, velocities, left)

    def execute(self, command: JointCommand) -> None:
        """Execute a command of joints, see `apply`."""
        self._check_vector("values", command.values)
        if command.velocity is not None:
            self._check_extra("velocity", command.velocity, command.mode)
        if command.effort_limit is not None:
            self._check_extra("effort_limit", command.effort_limit, command.mode)
            if command.effort_limit and min(command.effort_limit) < 0:
                self._reject(f"effort_limit {min(command.effort_limit)} is negative")
        if command.mode == "teleport":
            self._teleport(command)
            return
        if command.mode == "brake":
            self.stop()
            return
        if command.mode != self.mode:
            self._own(command.mode)
            if command.mode == "position":
                self._warnings.check_start(self._joints, self._positions(), command.values)
        self._warnings.check(self._joints, command)
        for drive, indices in self._indices:
            drive.command(command, indices, self._period)

    def _check_extra(self, field: str, vector: Sequence[float], mode: JointMode) -> None:
        if field not in _EXTRAS[mode]:
            self._reject(f"mode {mode} does not use {field}; remove it")
        self._check_vector(field, vector)

    def _check_vector(self, field: str, vector: Sequence[float]) -> None:
        if len(vector) != len(self._joints):
            self._reject(
                f"{field} has {len(vector)} entries for {len(self._joints)} joints "
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
                    f"joint {joint.name} has mode {joint.mode}, but the command has mode {mode}; "
                    "change the command, or 'mode' in the world file"
                )
            owner = self._motors.owners.setdefault(joint.name, self._port)
            if owner != self._port:
                self._reject(f"joint {joint.name} is already driven by input {owner!r}")
        self.mode = mode

    def _positions(self) -> list[float]:
        return [self._physics.state(joint)[0] for joint in self._joints]

    def _teleport(self, command: JointCommand) -> None:
        velocities = command.velocity or [0.0] * len(self._joints)
        for joint, position in zip(self._joints, command.values, strict=True):
            if text := joint.cannot_teleport(position):
                self._reject(text)
        states = zip(self._joints, self._drives, command.values, velocities, strict=True)
        for joint, (drive, index), position, velocity in states:
            self._physics.teleport(joint, position, velocity)
            drive.teleport(index, position)

    def _reject(self, text: str) -> NoReturn:
        raise CommandError(self._port, text)
