"""Executes the commands of each input; in an emergency, or without a command, it brakes."""

import math
import sys
from collections.abc import Callable, Sequence
from operator import le
from typing import Any, ClassVar, NoReturn

import msgspec

from stepbus_participant import InvalidInput, format_duration
from stepbus_plant.base import Base
from stepbus_plant.camera import Camera
from stepbus_plant.drives import Motors
from stepbus_plant.gripper import Gripper
from stepbus_plant.memory import Remembers
from stepbus_schemas import (
    Description,
    EmergencyStop,
    GripperCommand,
    JointCommand,
    JointMode,
    WiringError,
)

# Proportional gain from the width error to the finger velocity [1/s].
_GAIN = 10.0


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
        # A torque up to it is finite, and takes effect.
        self._most = [
            min(joint.effort, sys.float_info.max) if joint.motor else -1.0 for joint in self._joints
        ]
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
        ramp = self.state.ramp
        if ramp is None:
            return
        seconds = self._motors.period_ns * 1e-9
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
        values, most = command.values, self._most
        is_within = len(values) == len(most) and all(map(le, map(abs, values), most))
        if not is_within:
            self._check_vector("values", values)
        if command.velocity is not None:
            self._check_vector("velocity", command.velocity)
        if command.effort_limit is not None:
            self._check_vector("effort_limit", command.effort_limit)
        if command.mode == "teleport":
            self._teleport(command)
            return
        if command.mode == "brake":
            self.stop()
            return
        if command.mode != self.state.mode:
            self._own(command.mode)
        if command.mode != "torque" or not is_within:
            self._warnings.check(self._joints, command)
        for drive, indices in self._indices:
            drive.command(command, indices, self._period)

    def _check_vector(self, field: str, vector: Sequence[float]) -> None:
        if len(vector) != len(self._joints):
            self._reject(
                f"{field} has {len(vector)} entries for {len(self._joints)} joints "
                f"({', '.join(joint.name for joint in self._joints)})"
            )
        if not all(map(math.isfinite, vector)):
            rows = zip(self._joints, vector, strict=True)
            joint, value = next(row for row in rows if not math.isfinite(row[1]))
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


class BaseDriver(Commander):
    """Executes the commands of one input to a base; a command holds until the next one."""

    def __init__(self, port: str, base: Base, motors: Motors) -> None:
        super().__init__(port, [joint.name for joint in base.joints], motors)
        self._base = base

    def apply(self, command: Any) -> None:
        """Execute a BaseCommand from now on; velocities of its wheels go over those of the base."""
        wheels = command.wheels or self._base.wheel_velocities(command.vx, command.wz)
        super().apply(JointCommand(mode="velocity", values=list(wheels)))


class GripperDriver(Commander):
    """Executes the commands of one input to a gripper; a command holds until the next one."""

    obeys_stop: ClassVar[bool] = False

    def __init__(self, port: str, gripper: Gripper, motors: Motors) -> None:
        super().__init__(port, [joint.name for joint in gripper.joints], motors)
        self._gripper = gripper

    def apply(self, command: Any) -> None:
        """Execute a GripperCommand from now on."""
        self.state.held = command

    def before_step(self) -> None:
        """Move both fingers towards the width, with no more than the commanded force."""
        if (held := self.state.held) is None:
            return
        gap, speed = held.width - self._gripper.width(), self._gripper.speed
        velocity = min(max(_GAIN * gap / 2, -speed), speed)
        limits = [held.force] * 2
        self.execute(JointCommand(mode="velocity", values=[velocity] * 2, effort_limit=limits))


class TriggerDriver(Commander):
    """Passes the requests of one input on to a camera."""

    obeys_stop: ClassVar[bool] = False

    def __init__(self, port: str, camera: Camera, motors: Motors) -> None:
        super().__init__(port, [], motors)
        camera.wait_for_triggers()
        self._camera = camera
        self._id: int | None = None

    def apply(self, command: Any) -> None:
        """Ask for an image, once per id of a CameraTrigger."""
        if command.id != self._id:
            self._id = command.id
            self._camera.trigger()


class StopSwitch(Remembers):
    """Brakes what the drivers move from one change to the next, whatever is commanded meanwhile.

    drivers: by input; those of grippers do not obey, and keep what they hold. state: of now.
    """

    remembers, parts = ("state",), ("drivers",)
    state: EmergencyStop
    description = Description()

    def __init__(self) -> None:
        self.drivers: dict[str, Commander] = {}
        self.state = EmergencyStop(active=False)

    def set(self, t_ns: int, by: str, record: Callable[[int, str], None], *, active: bool) -> None:
        """Stop, or let commands move again; what is so already stays as it is.

        t_ns: now [ns]. by: who asks. record: takes the time and what has happened.
        """
        if active == self.state.active:
            return
        self.state = EmergencyStop(active=active, by=by, since=t_ns * 1e-9)
        for driver in self.drivers.values():
            if active and driver.obeys_stop:
                driver.halt()
        record(t_ns, f"emergency stop{'' if active else ' released'} by {by}")

    def sense(self, _t_ns: int) -> EmergencyStop:
        """Return the state."""
        return self.state

    def watch(self, t_ns: int, longest_ns: int, record: Callable[[int, str], None]) -> None:
        """Halt what has had no command for some time, until the next one; record: as of `set`.

        longest_ns: how long that is [ns]. A driver that has had no command yet is left alone.
        """
        for port, driver in self.drivers.items():
            heard_ns = driver.state.heard_ns
            if driver.obeys_stop and heard_ns is not None and t_ns - heard_ns >= longest_ns:
                driver.state.heard_ns = None
                driver.halt()
                longest = format_duration(longest_ns)
                record(t_ns, f"no command on input {port!r} for {longest}: it brakes")
