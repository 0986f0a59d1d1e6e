"""A mobile base with two driven wheels: commands and odometry."""

import math

from stepbus_plant.engine import Engine
from stepbus_plant.joint import Joint, describe_joints
from stepbus_plant.memory import Remembers
from stepbus_plant.noise import Noise
from stepbus_plant.params import OdometryErrors
from stepbus_plant.world import BaseSettings
from stepbus_schemas import BaseState, Description


class Base(Remembers):
    """A differential drive and its odometry; wheels: left, right.

    Odometry integrates the wheel angles; it does not notice slip, which `errors` adds: the physics
    has none of that size. It treats the path between two readings as a circular arc, which is exact
    for constant wheel velocities (R. Siegwart, I. Nourbakhsh: Introduction to Autonomous Mobile
    Robots, 2004, section 5.2.4).
    """

    remembers = ("_angles", "_readings", "_x", "_y", "_yaw")
    _angles: tuple[float, float]

    def __init__(
        self,
        row: BaseSettings,
        wheels: tuple[Joint, Joint],
        engine: Engine,
        errors: OdometryErrors,
        noise: Noise,
    ) -> None:
        self._errors, self._noise = errors, noise
        one, other = noise.at(0).normal(0.0, 1.0, 2).tolist()
        self._scale = (1.0 + errors.wheel * one, 1.0 + errors.wheel * other)
        self._readings = 0
        self.joints = wheels
        self._row = row
        self._engine = engine
        self._angles = self._read()[0]
        self._x = self._y = self._yaw = 0.0

    @property
    def description(self) -> Description:
        """The wheels, and their limits."""
        return describe_joints(self.joints)

    def _read(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the angles [rad] and velocities [rad/s] of the left and right wheel."""
        left, right = self.joints
        one, other = self._engine.read(left.body, [left.index, right.index])
        return (one[0], other[0]), (one[1], other[1])

    def sense(self, _t_ns: int) -> BaseState:
        """Return the current odometry; call it at every step."""
        angles, velocities = self._read()
        arc, turn = self.base_motion(
            *self._disturbed(angles[0] - self._angles[0], angles[1] - self._angles[1])
        )
        self._angles = angles
        # sinc() gives the chord of the arc.
        chord = arc if turn == 0.0 else arc * math.sin(turn / 2) / (turn / 2)
        self._x += chord * math.cos(self._yaw + turn / 2)
        self._y += chord * math.sin(self._yaw + turn / 2)
        self._yaw += turn
        vx, wz = self.base_motion(*(v * k for v, k in zip(velocities, self._scale, strict=True)))
        return BaseState(x=self._x, y=self._y, yaw=self._yaw, vx=vx, wz=wz)

    def _disturbed(self, left: float, right: float) -> tuple[float, float]:
        """Return the angles that the wheels would have turned by had they not slipped [rad]."""
        self._readings += 1
        left, right = left * self._scale[0], right * self._scale[1]
        if not self._errors.slip:
            return left, right
        radius = self._row.wheel_radius
        one, other = self._noise.at(self._readings).normal(0.0, self._errors.slip / radius, 2)
        left += float(one) * math.sqrt(abs(left) * radius)
        return left, right + float(other) * math.sqrt(abs(right) * radius)

    def base_motion(self, left: float, right: float) -> tuple[float, float]:
        """Return travel and turn of the base from the wheel angles; likewise for velocities."""
        radius = self._row.wheel_radius
        return radius * (left + right) / 2, radius * (right - left) / self._row.track

    def wheel_velocities(self, vx: float, wz: float) -> list[float]:
        """Return the velocities of the left and right wheel [rad/s] for a velocity of the base."""
        side = wz * self._row.track / 2
        return [(vx - side) / self._row.wheel_radius, (vx + side) / self._row.wheel_radius]
