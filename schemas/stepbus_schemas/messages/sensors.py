"""What sensors measure, each in its own frame."""

from typing import Annotated

from stepbus_schemas.messages.base import Message, Point, Quaternion, meta


class Imu(Message, frozen=True):
    """Measurement of an inertial unit, in the frame of its link."""

    angular_velocity: Annotated[Point, meta("angular velocity: x, y, z", "rad/s", "3")]
    linear_acceleration: Annotated[
        Point, meta("specific force: x, y, z; at rest, it points up with 9.81", "m/s²", "3")
    ]
    orientation: Annotated[
        Quaternion | None,
        meta("orientation in the world frame, quaternion x, y, z, w; absent: not sensed", "-", "4"),
    ] = None


class Wrench(Message, frozen=True):
    """A force and a torque, in the frame of the sensor."""

    force: Annotated[Point, meta("force: x, y, z", "N", "3")]
    torque: Annotated[Point, meta("torque about the origin of the frame: x, y, z", "N·m", "3")]


class LaserScan(Message, frozen=True):
    """Ranges in a plane: x points ahead, angles are counter-clockwise about z.

    Ray i has the angle `angle_min` + i · `angle_increment`.
    """

    angle_min: Annotated[float, meta("angle of the first ray", "rad")]
    angle_increment: Annotated[float, meta("angle between two rays", "rad")]
    range_min: Annotated[float, meta("smallest range that is measured", "m")]
    range_max: Annotated[float, meta("largest range that is measured", "m")]
    ranges: Annotated[
        list[float],
        meta("range of each ray; +inf: nothing within range, -inf: closer than measured", "m", "k"),
    ]
    intensities: Annotated[
        list[float], meta("intensity of each echo; empty: not sensed", "-", "k")
    ] = []


class PointCloud(Message, frozen=True):
    """Points that a depth sensor sees, in its frame; for a bulk port."""

    count: Annotated[int, meta("number of points", ge=0)]
    points: Annotated[bytes, meta("x, y, z of each point, float32 LE", "m", "count 3")]
    colours: Annotated[
        bytes | None,
        meta("bytes red, green, blue of each point; absent: not sensed", "", "count 3"),
    ] = None


class Transforms(Message, frozen=True):
    """Transforms between frames: the pose of each child in the frame of its parent."""

    parents: Annotated[list[str], meta("parent frame of each transform", "", "k")]
    children: Annotated[list[str], meta("child frame of each transform", "", "k")]
    position: Annotated[list[Point], meta("origin of the child in its parent: x, y, z", "m", "k 3")]
    orientation: Annotated[
        list[Quaternion],
        meta("orientation of the child in its parent: quaternion x, y, z, w", "-", "k 4"),
    ]
