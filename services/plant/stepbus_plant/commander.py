"""Checks the commands of one input and passes them to the drives of their joints."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar, NoReturn

import msgspec

from stepbus_participant import InvalidInput
from stepbus_plant.drives import Motors
from stepbus_plant.memory import Remembers
from stepbus_schemas import GripperCommand, JointCommand, JointMode, WiringError


class CommandError(InvalidInput, ValueError):
    """An invalid command; its sender is to blame."""


class Ramp(msgspec.Struct):
    """Brings joints to rest together.

    positions, velocities: of now [rad, rad/s]. left: until they are at rest [s].
    """

    positions: list[float]
    velocities: list[float]
    left: float


class DriverState(msgspec.Struct):
    """The state of a driver, for a checkpoint.

    mode: of the last command. ramp: brings its joints to rest; None: they move as commanded, or
    are at rest. held: a command that each step executes anew. heard_ns: time of the last command
    [ns]; None: the watchdog does not wait for one.
    """

    mode: JointMode | None = None
    ramp: Ramp | None = None
    held: GripperCommand | None = None
    heard_ns: int | None = None


class Commander(Remembers):
    """Executes the commands of one input; there may be several, one for each arm.

    port: name of the input, for messages. names: joints of the vectors, in order. period_ns:
    between two commands [ns]; default: the plant's step. state: mutable.
    Raises WiringError for names that are unknown, fixed or duplicate.
    """

    remembers = ("state",)
    state: DriverState
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
        self.state = DriverState()
        self._check_names(names)
        self._joints = [self._physics.joints[name] for name in names]
        self._drives = [motors.drive_of[name] for name in names]
        self._indices = [
            (drive, [(i, source) for source, (d, i) in enumerate(self._drives) if d is drive])
            for drive in dict.fromkeys(drive for drive, _ in self._drives)
        ]

    def _check_names(self, names: Sequence[str]) -> None:
        texts = [(name, self._physics.lacks_joint(name)) for name in names]
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        mistakes = [f"joint {name!r} {text}" for name, text in texts if text]
        mistakes += [f"joint {name!r} is listed twice" for name in twice]
        if mistakes:
            raise WiringError("\n".join(mistakes))

    def apply(self, command: Any) -> None:
        """Execute a JointCommand from now on; an invalid one has no effect at all.

        Raises CommandError for a vector of the wrong length, a value that is not finite, a mode
        that a joint does not accept, a teleport beyond a stop, and a joint that another input
        drives. Every joint accepts mode brake.
        """
        self.state.ramp = None
        self.execute(command)

    def before_step(self) -> None:
        """Prepare a communication step, with or without a new command: the drives keep theirs."""
        ramp, seconds = self.state.ramp, self._motors.period_ns * 1e-9
        if ramp is None:
            return
        if ramp.left <= seconds:
            self.stop()
            return
        share = 1.0 - seconds / ramp.left
        rows = zip(ramp.positions, ramp.velocities, strict=True)
        ramp.positions = [p + (v + v * share) / 2 * seconds for p, v in rows]
        ramp.velocities = [v * share for v in ramp.velocities]
        ramp.left -= seconds
        if self.state.mode == "velocity":
            self.execute(JointCommand(mode="velocity", values=ramp.velocities))
        else:
            self.execute(
                JointCommand(mode="position", values=ramp.positions, velocity=ramp.velocities)
            )

    def stop(self) -> None:
        """Hold every joint at its current position; a repeated brake keeps the first one."""
        self.state.ramp = None
        if self.state.mode == "brake":
            return
        for joint, (drive, index) in zip(self._joints, self._drives, strict=True):
            drive.brake(index, self._physics.state(joint)[0])
        self.state.mode = "brake"

    def halt(self) -> None:
        """Come to rest in an emergency stop; `before_step` is called all the while."""
        brakes = [joint.brake for joint in self._joints if joint.brake is not None]
        if len(brakes) < len(self._joints) or self.state.mode not in ("velocity", "position"):
            self.stop()
            return
        states = [self._physics.state(joint) for joint in self._joints]
        positions, velocities = map(list, zip(*states, strict=True))
        # Each no harder than it may brake.
        left = max(abs(v) / most for v, most in zip(velocities, brakes, strict=True))
        self.state.ramp = Ramp(positions, velocities, left)

    def execute(self, command: JointCommand) -> None:
        """Execute a command of joints, see `apply`."""
        for field in ("values", "velocity", "effort_limit"):
            if (vector := getattr(command, field)) is not None:
                self._check_vector(field, vector)
        if command.mode == "teleport":
            self._teleport(command)
            return
        if command.mode == "brake":
            self.stop()
            return
        if command.mode != self.state.mode:
            self._own(command.mode)
        self._warnings.check(self._joints, command)
        for drive, indices in self._indices:
            drive.command(command, indices, self._period)

    def _check_vector(self, field: str, vector: Sequence[float]) -> None:
        if len(vector) != len(self._joints):
            self._reject(
                f"{field} has {len(vector)} entries for {len(self._joints)} joints "
                f"({', '.join(joint.name for joint in self._joints)})"
            )
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
        self.state.mode = mode

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
