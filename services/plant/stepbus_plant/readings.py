"""What sensors read: accelerations, distances and forces, with their errors and noise."""

import math
import zlib

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from stepbus_plant.devices.sensor_errors import Errors
from stepbus_plant.frames import Frame, point, read_frame, rotation_of, tilted
from stepbus_plant.poses import LinkIndex
from stepbus_plant.world_sensors import ImuSettings, LidarSettings, WrenchSettings
from stepbus_schemas import Description, Imu, LaserScan, Wrench


class Noise:
    """Random numbers for one purpose of one sensor.

    seed: of the plant. purpose: such as `odometry`; name: of the sensor. Each pair has a stream of
    its own, so that a base and a contact sensor may have the same name. Philox (Salmon et al.,
    Parallel random numbers: as easy as 1, 2, 3, 2011) computes them from a counter, so that what
    other sensors do, and whether this one was on before, changes none.
    """

    def __init__(self, seed: int, purpose: str, name: str = "") -> None:
        self._key = np.array(
            [seed & (2**64 - 1), zlib.crc32(f"{purpose}/{name}".encode())], dtype=np.uint64
        )

    def at(self, number: int) -> np.random.Generator:
        """Return the generator of a reading; number: ≥ 0, such as a time [ns]."""
        counter = np.array([0, 0, number, 0], dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))


class WrenchSensor:
    """Measures what everything beyond a joint exerts on it, in the frame of the joint's child link.

    PyBullet reports the reaction of the latest substep, in the frame of the child's centre of mass
    and about it.
    """

    def __init__(
        self, name: str, row: WrenchSettings, joint: LinkIndex, client: int, seed: int
    ) -> None:
        self._row = row
        self._joint = joint
        self._client = client
        inertial = bullet.getDynamicsInfo(*joint, client)[3:5]
        self._centre, self._rotation = np.array(inertial[0]), rotation_of(inertial[1])
        bullet.enableJointForceTorqueSensor(*joint, True, client)

        def errors(quantity: str) -> Errors:
            noise, bias = getattr(row.noise, quantity), getattr(row.bias, quantity)
            return Errors(seed, f"wrenches/{name}/{quantity}", noise, bias, 3)

        self._force, self._torque = errors("force"), errors("torque")

    def describe(self) -> Description:
        """Return the joint."""
        return Description(names=[self._row.joint])

    def sense(self, _t_ns: int) -> Wrench:
        """Return the current reading; 0 before the first step."""
        reaction = np.array(bullet.getJointState(*self._joint, self._client)[2])
        force = -self._rotation @ reaction[:3]
        torque = np.cross(self._centre, force) - self._rotation @ reaction[3:]
        return Wrench(
            force=point(self._force.disturb(force)), torque=point(self._torque.disturb(torque))
        )


class Lidar:
    """Casts rays in the x-y plane of a link, counter-clockwise from `angle_min` about z.

    A ray begins at `range_min`, so that it does not see the sensor's own housing.
    """

    def __init__(
        self, name: str, row: LidarSettings, link: LinkIndex, client: int, seed: int
    ) -> None:
        self._row = row
        self._link = link
        self._client = client
        steps = max(row.rays - 1, 1)
        self._increment = (row.angle_max - row.angle_min) / steps
        angles = row.angle_min + self._increment * np.arange(row.rays)
        self._directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(row.rays)], axis=1)
        # The rays of a unit have one offset, and noise of their own.
        self._offset = Errors(seed, f"lidars/{name}/bias", 0.0, row.bias, 1)
        self._noise = Errors(seed, f"lidars/{name}/ranges", row.noise, 0.0, row.rays)
        # Before the first step, the engine's bounding boxes are those of loading.
        bullet.performCollisionDetection(client)

    def describe(self) -> Description:
        """Return the link, and the number of rays."""
        return Description(names=[self._row.link], shape=[self._row.rays])

    def sense(self, _t_ns: int) -> LaserScan:
        """Return a scan of the world as it is now."""
        row = self._row
        return LaserScan(
            angle_min=row.angle_min,
            angle_increment=self._increment,
            range_min=row.range_min,
            range_max=row.range_max,
            ranges=[float(value) for value in self._ranges()],
        )

    def _ranges(self) -> NDArray[np.float64]:
        row = self._row
        frame = read_frame(self._client, self._link)
        directions = self._directions @ frame.rotation.T
        starts = frame.position + row.range_min * directions
        ends = frame.position + row.range_max * directions
        hits = bullet.rayTestBatch(
            starts.tolist(), ends.tolist(), numThreads=1, physicsClientId=self._client
        )
        distances = np.array([hit[2] if hit[0] >= 0 else math.inf for hit in hits])
        ranges = row.range_min + distances * (row.range_max - row.range_min)
        seen = np.isfinite(ranges)
        disturbed = self._noise.disturb(self._offset.disturb(np.zeros(1))[0] + ranges)
        disturbed[seen & (disturbed > row.range_max)] = math.inf
        disturbed[seen & (disturbed < row.range_min)] = -math.inf
        result: NDArray[np.float64] = np.where(seen, disturbed, math.inf)
        return result


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
