"""A mobile base with two driven wheels: its commands, and its odometry."""

from __future__ import annotations

import math

from stepbus_plant.errors import CommandError
from stepbus_plant.joints.commander import Commander
from stepbus_plant.physics.engine import Physics
from stepbus_plant.physics.joint import Joint, describe_joints
from stepbus_plant.world.file import BaseRow
from stepbus_schemas import BaseCommand, BaseState, Description, JointCommand


class Base:
    """Two wheels on one axle, and where they have taken the base.

    Odometry sees the turning of the wheels alone: a wheel that slips is not noticed. Each reading
    takes the way since the one before for an arc of a circle, which is exact for steady wheels
    (R. Siegwart, I. Nourbakhsh: Introduction to Autonomous Mobile Robots, 2004, section 5.2.4).
    """

    def __init__(self, row: BaseRow, left: Joint, right: Joint, physics: Physics) -> None:
        self.joints = (left, right)
        self._row = row
        self._physics = physics
        self._wheels = (left.body, [left.index, right.index])
        self._angles = self._read()[0]
        self._x = self._y = self._yaw = 0.0

    def _read(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the angles [rad] and velocities [rad/s] of the left and right wheel."""
        left, right = self._physics.read(*self._wheels)
        return (left[0], right[0]), (left[1], right[1])

    def describe(self) -> Description:
        """Return names and limits of its wheels: left, right."""
        return describe_joints(self.joints)

    def sense(self) -> BaseState:
        """Return the odometry now; to be called at every step."""
        angles, velocities = self._read()
        way, turn = self._body(angles[0] - self._angles[0], angles[1] - self._angles[1])
        self._angles = angles
        # The chord of the arc, which sinc() makes shorter than the arc itself.
        chord = way if turn == 0.0 else way * math.sin(turn / 2) / (turn / 2)
        self._x += chord * math.cos(self._yaw + turn / 2)
        self._y += chord * math.sin(self._yaw + turn / 2)
        self._yaw += turn
        vx, wz = self._body(*velocities)
        return BaseState(x=self._x, y=self._y, yaw=self._yaw, vx=vx, wz=wz)

    def _body(self, left: float, right: float) -> tuple[float, float]:
        """Return way and turn of the base from those of its wheels; velocities likewise."""
        radius = self._row.wheel_radius
        return radius * (left + right) / 2, radius * (right - left) / self._row.track

    def wheel_velocities(self, vx: float, wz: float) -> list[float]:
        """Return the velocities of the left and right wheel [rad/s] for one of the base."""
        side = wz * self._row.track / 2
        return [(vx - side) / self._row.wheel_radius, (vx + side) / self._row.wheel_radius]


class BaseDriver:
    """Carries out the commands of one input to a base; a command holds until the next one.

    port: name of the input, for messages. commander: of the base's wheels.
    """

    def __init__(self, port: str, base: Base, commander: Commander) -> None:
        self._port = port
        self._base = base
        self._commander = commander

    def apply(self, command: BaseCommand) -> None:
        """Carry out a command from now on.

        Raises CommandError for a value that is no finite number, and when it has velocities of
        the base and of the wheels at once.
        """
        if command.wheels is None:
            for field, value in (("vx", command.vx), ("wz", command.wz)):
                if not math.isfinite(value):
                    raise CommandError(
                        f"input {self._port!r}: {field} is {value}, not a finite number"
                    )
            velocities = self._base.wheel_velocities(command.vx, command.wz)
        elif command.vx != 0.0 or command.wz != 0.0:
            raise CommandError(
                f"input {self._port!r}: has vx {command.vx:g}, wz {command.wz:g} and wheels at "
                "once; give the velocity of the base or of its wheels"
            )
        else:
            velocities = list(command.wheels)
        self._commander.apply(JointCommand(mode="velocity", values=velocities))

    def before_step(self) -> None:
        """Do nothing: the wheels keep their velocities."""
