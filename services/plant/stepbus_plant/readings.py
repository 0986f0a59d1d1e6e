"""What sensors on links and joints read: accelerations, distances, forces and transforms.

Each is made from its name for random numbers, such as `imus/torso`, its row of the world file, the
physics and the plant's seed.
"""

import math
from typing import Any

import numpy as np

from stepbus_plant.geometry import Array, Geometry, Pose, rotation
from stepbus_plant.memory import Remembers
from stepbus_plant.noise import Errors, seed_of
from stepbus_plant.physics import Physics
from stepbus_plant.world import WORLD, ImuSettings, LidarSettings, TransformSettings, WrenchSettings
from stepbus_schemas import Description, Imu, LaserScan, Point, Quaternion, Transforms, Wrench


class WrenchSensor(Remembers):
    """Measures what everything beyond a joint exerts on it, in the frame of the joint's child link.

    The engine reports the reaction in the frame of the child's centre of mass, and about it.
    """

    parts = ("_force", "_torque")

    def __init__(self, stream: str, row: WrenchSettings, physics: Physics, seed: int) -> None:
        self._joint = physics.all_joints()[row.joint]
        self._engine = physics.engine
        centre, orientation = self._engine.inertial(self._joint)
        self._centre, self._rotation = np.array(centre), rotation(orientation)
        self._engine.watch_reaction(self._joint)
        self._force = _errors(seed, stream, row, "force")
        self._torque = _errors(seed, stream, row, "torque")
        self.description = Description(names=[row.joint])

    def sense(self, _t_ns: int) -> Wrench:
        """Return the current reading; 0 before the first step."""
        reaction, about_centre = self._engine.reaction(self._joint)
        force = -self._rotation @ reaction
        torque = np.cross(self._centre, force) - self._rotation @ about_centre
        return Wrench(
            force=_point(self._force.disturb(force)), torque=_point(self._torque.disturb(torque))
        )


class Lidar(Remembers):
    """Casts rays in the x-y plane of a link, counter-clockwise from `angle_min` about z.

    A ray begins at `range_min`, so that it does not see the sensor's own housing.
    """

    parts = ("_offset", "_noise")

    def __init__(self, stream: str, row: LidarSettings, physics: Physics, seed: int) -> None:
        self._row = row
        self._link = physics.links[row.link]
        self._engine = physics.engine
        self._increment = (row.angle_max - row.angle_min) / max(row.rays - 1, 1)
        angles = row.angle_min + self._increment * np.arange(row.rays)
        self._directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(row.rays)], axis=1)
        # The rays of a unit have one offset, and noise of their own.
        self._offset = Errors(seed_of(seed, f"{stream}/bias"), 0.0, row.bias, 1)
        self._noise = Errors(seed_of(seed, f"{stream}/ranges"), row.noise, 0.0, row.rays)
        self._engine.update_shapes()
        self.description = Description(names=[row.link], shape=[row.rays])

    def sense(self, _t_ns: int) -> LaserScan:
        """Return a scan of the world as it is now."""
        row = self._row
        return LaserScan(
            angle_min=row.angle_min,
            angle_increment=self._increment,
            range_min=row.range_min,
            range_max=row.range_max,
            ranges=self._ranges().tolist(),
        )

    def _ranges(self) -> Array:
        row = self._row
        position, orientation = self._engine.frame(self._link)
        directions = self._directions @ rotation(orientation).T
        starts, ends = (position + r * directions for r in (row.range_min, row.range_max))
        ranges = row.range_min + self._engine.cast(starts, ends) * (row.range_max - row.range_min)
        seen = np.isfinite(ranges)
        disturbed = self._noise.disturb(self._offset.disturb(np.zeros(1))[0] + ranges)
        disturbed[seen & (disturbed > row.range_max)] = math.inf
        disturbed[seen & (disturbed < row.range_min)] = -math.inf
        result: Array = np.where(seen, disturbed, math.inf)
        return result


class ImuSensor(Remembers):
    """Measures angular velocity and specific force in the frame of a link.

    The specific force is the mean since the last reading, as of a unit that integrates: the change
    of velocity over that time, minus gravity. At the first reading, it is that of rest.
    """

    remembers, parts = ("_before",), ("_gyro", "_accelerometer", "_compass")
    _before: tuple[Point, int] | None = None

    def __init__(self, stream: str, row: ImuSettings, physics: Physics, seed: int) -> None:
        self._row = row
        self._link = physics.links[row.link]
        self._engine = physics.engine
        self._gravity = np.array(physics.world.gravity)
        self._gyro = _errors(seed, stream, row, "angular_velocity")
        self._accelerometer = _errors(seed, stream, row, "linear_acceleration")
        self._compass = _errors(seed, stream, row, "orientation")
        self.description = Description(names=[row.link])

    def sense(self, t_ns: int) -> Imu:
        """Return the reading at a time [ns]."""
        motion = self._engine.motion(self._link)
        (position, orientation), spin = motion.frame, np.array(motion.spin)
        arm = np.array(position) - np.array(motion.centre)
        velocity = np.array(motion.velocity) + np.cross(spin, arm)
        acceleration = np.zeros(3)
        if self._before is not None and t_ns > self._before[1]:
            before, then_ns = self._before
            acceleration = (velocity - before) / ((t_ns - then_ns) * 1e-9)
        self._before = _point(velocity), t_ns
        to_link = rotation(orientation).T
        measured_spin = self._gyro.disturb(to_link @ spin)
        force = self._accelerometer.disturb(to_link @ (acceleration - self._gravity))
        measured = _tilted(self._engine.geometry, orientation, self._compass.disturb(np.zeros(3)))
        return Imu(
            angular_velocity=_point(measured_spin),
            linear_acceleration=_point(force),
            orientation=measured if self._row.orientation else None,
        )


class TransformSensor(Remembers):
    """Measures where links are in the frame of another link, or of the world."""

    parts = ("_position", "_orientation")

    def __init__(self, stream: str, row: TransformSettings, physics: Physics, seed: int) -> None:
        self._names = list(row.links)
        self._parent = row.parent
        self._indices = physics.links
        self._engine = physics.engine
        count = 3 * len(self._names)
        self._position = _errors(seed, stream, row, "position", count)
        self._orientation = _errors(seed, stream, row, "orientation", count)
        self.description = Description(names=self._names)

    def sense(self, _t_ns: int) -> Transforms:
        """Return the current transforms."""
        poses: list[Pose] = [self._engine.frame(self._indices[name]) for name in self._names]
        if self._parent != WORLD:
            from_world = self._engine.geometry.inverse(
                self._engine.frame(self._indices[self._parent])
            )
            poses = [self._engine.geometry.compose(from_world, pose) for pose in poses]
        count = len(poses)
        true = np.array([position for position, _ in poses]).reshape(-1)
        positions = self._position.disturb(true).reshape(count, 3)
        angles = self._orientation.disturb(np.zeros(3 * count)).reshape(count, 3)
        return Transforms(
            parents=[self._parent] * count,
            children=self._names,
            position=[_point(row) for row in positions],
            orientation=[
                _tilted(self._engine.geometry, orientation, turn)
                for (_, orientation), turn in zip(poses, angles, strict=True)
            ],
        )


def _errors(seed: int, stream: str, row: Any, quantity: str, count: int = 3) -> Errors:
    """Return the errors of a quantity, as a row of the world file has them."""
    noise, bias = getattr(row.noise, quantity), getattr(row.bias, quantity)
    return Errors(seed_of(seed, f"{stream}/{quantity}"), noise, bias, count)


def _point(values: Array) -> Point:
    """Return three numbers as a message has them."""
    x, y, z = values.tolist()
    return x, y, z


def _tilted(geometry: Geometry, orientation: Quaternion, angles: Array) -> Quaternion:
    """Return an orientation turned by small angles about its own axes [rad]."""
    if not angles.any():
        return orientation
    turn = np.array([*(angles / 2), 1.0])
    x, y, z, w = (turn / np.linalg.norm(turn)).tolist()
    return geometry.compose(((0, 0, 0), orientation), ((0, 0, 0), (x, y, z, w)))[1]
