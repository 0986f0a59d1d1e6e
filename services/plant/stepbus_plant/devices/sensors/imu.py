"""An inertial unit on a link."""

import numpy as np
from numpy.typing import NDArray

from stepbus_plant.devices.poses import LinkIndex
from stepbus_plant.world.sensors import ImuSettings
from stepbus_schemas import Description, Imu

from .errors import Errors
from .frames import Frame, point, read_frame, tilted


class ImuSensor:
    """Measures angular velocity and specific force in the frame of a link.

    The specific force is the mean since the last reading, as of a unit that integrates: the change
    of velocity over that time, minus gravity. At the first reading, it is that of rest.
    """

    def __init__(
        self,
        name: str,
        row: ImuSettings,
        link: LinkIndex,
        client: int,
        *,
        gravity: NDArray[np.float64],
        seed: int,
    ) -> None:
        self._row = row
        self._link = link
        self._client = client
        self._gravity = gravity
        self._before: tuple[Frame, int] | None = None

        def errors(quantity: str) -> Errors:
            noise, bias = getattr(row.noise, quantity), getattr(row.bias, quantity)
            return Errors(seed, f"imus/{name}/{quantity}", noise, bias, 3)

        self._gyro = errors("angular_velocity")
        self._accelerometer = errors("linear_acceleration")
        self._compass = errors("orientation")

    def describe(self) -> Description:
        """Return the link."""
        return Description(names=[self._row.link])

    def sense(self, t_ns: int) -> Imu:
        """Return the reading at a time [ns]."""
        frame = read_frame(self._client, self._link)
        acceleration = np.zeros(3)
        if self._before is not None and t_ns > self._before[1]:
            before, then_ns = self._before
            acceleration = (frame.velocity - before.velocity) / ((t_ns - then_ns) * 1e-9)
        self._before = frame, t_ns
        spin = self._gyro.disturb(frame.rotation.T @ frame.spin)
        force = self._accelerometer.disturb(frame.rotation.T @ (acceleration - self._gravity))
        angles = self._compass.disturb(np.zeros(3))
        orientation = tilted(frame.orientation, angles) if angles.any() else frame.orientation
        return Imu(
            angular_velocity=point(spin),
            linear_acceleration=point(force),
            orientation=orientation if self._row.orientation else None,
        )
