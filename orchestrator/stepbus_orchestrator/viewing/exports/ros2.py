"""A recording as an MCAP file of ROS 2: `ros2 bag` and rosbags read it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from stepbus_orchestrator.analysis.replaced import replaced
from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.viewing.scene import Pose
from stepbus_participant import need
from stepbus_schemas import (
    BaseState,
    Event,
    Image,
    Imu,
    JointReference,
    JointState,
    LaserScan,
    Message,
    TextMessage,
    Wrench,
)

from .files import Exported
from .moments import NS, Moment, Moving, moments, readable
from .progress import Reached

_TF_PERIOD_NS = NS // 50
_WORLD = "world"
_KEPT = """- history: keep_last
  depth: 1
  reliability: reliable
  durability: transient_local
  deadline: {sec: 2147483647, nsec: 4294967295}
  lifespan: {sec: 2147483647, nsec: 4294967295}
  liveliness: automatic
  liveliness_lease_duration: {sec: 2147483647, nsec: 4294967295}
  avoid_ros_namespace_conventions: false
"""
"""Quality of service of what a late subscriber gets too."""


def export_ros2(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write the messages that ROS 2 has a type for.

    Joints, odometry, images with their camera info, inertial units, wrenches, laser scans and
    texts; the poses of all frames as /tf, fifty times a second; the robot's description.

    Raises RecordingFailed when nothing can be exported or the file cannot be written, ExtraMissing
    without the library.
    """
    lost: dict[str, str] = {}
    ports = readable(recording, lost)
    moving = Moving(recording, _TF_PERIOD_NS)
    problems = list(moving.scene.notes)
    ros = _Ros()
    wanted = [p for p in ports if p.type in _CONVERTERS or p.topic in moving.scene.topics]
    left = [f"{p.topic} ({p.type})" for p in ports if p not in wanted]
    if left:
        problems.append(f"ROS 2 has no type for {', '.join(left)}: left out")
    with replaced(target) as path, path.open("wb") as stream:
        bag = _Bag(stream, ros)
        for number, (name, text) in enumerate(moving.scene.robots.items()):
            topic = "/robot_description" if number == 0 else f"/{name}/robot_description"
            bag.add(topic, "std_msgs/msg/String", ros.make("std_msgs/msg/String", data=text), 0)
        bag.add("/tf_static", _TF, ros.transforms(moving, moving.still(), 0), 0)
        for moment in moments(recording, wanted, lost, reached):
            placed = moving.take(moment)
            if placed:
                bag.add("/tf", _TF, ros.transforms(moving, placed, moment.t_ns), moment.t_ns)
            convert = _CONVERTERS.get(moment.port.type)
            for suffix, type_name, message in convert(ros, moment) if convert else ():
                bag.add(_topic(moment.port, suffix), type_name, message, moment.t_ns)
        bag.close()
    problems += lost.values()
    return Exported(paths=[target], problems=problems, lost=list(lost))


def _topic(port: Port, suffix: str) -> str:
    return f"/{port.participant}/{port.name}{suffix}".replace("-", "_")


_TF = "tf2_msgs/msg/TFMessage"
Converted = Iterator[tuple[str, str, Any]]
"""End of the topic, type and message."""


class _Ros:
    """The message types of ROS 2, and what makes their parts."""

    def __init__(self) -> None:
        (typesys,) = need("the export for ROS 2", "rosbags.typesys")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)

    def make(self, type_name: str, **fields: Any) -> Any:
        return self._store.types[type_name](**fields)

    def row(self, type_name: str, suffix: str = "", **fields: Any) -> tuple[str, str, Any]:
        """Return the end of a topic, the type and the message."""
        return suffix, type_name, self.make(type_name, **fields)

    def bytes_of(self, type_name: str, message: Any) -> bytes:
        return bytes(self._store.serialize_cdr(message, type_name))

    def definition(self, type_name: str) -> bytes:
        text, _ = self._store.generate_msgdef(type_name, ros_version=2)
        return str(text).encode()

    def header(self, t_ns: int, frame: str) -> Any:
        stamp = self.make("builtin_interfaces/msg/Time", sec=t_ns // NS, nanosec=t_ns % NS)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def vector(self, values: Any, name: str = "Vector3") -> Any:
        x, y, z = map(float, values)
        return self.make(f"geometry_msgs/msg/{name}", x=x, y=y, z=z)

    def quaternion(self, xyzw: Any) -> Any:
        x, y, z, w = map(float, xyzw)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def transforms(self, moving: Moving, placed: Mapping[str, Pose], t_ns: int) -> Any:
        """Return frames and their poses in their parents."""
        parents = {frame.name: frame.parent for frame in moving.scene.frames}
        rows = []
        for name, pose in placed.items():
            w, x, y, z = pose.wxyz
            transform = self.make(
                "geometry_msgs/msg/Transform",
                translation=self.vector(pose.position),
                rotation=self.quaternion((x, y, z, w)),
            )
            rows.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(t_ns, parents[name] or _WORLD),
                    child_frame_id=name,
                    transform=transform,
                )
            )
        return self.make(_TF, transforms=rows)


class _Bag:
    """The file. Channels are added when their first message comes."""

    def __init__(self, stream: Any, ros: _Ros) -> None:
        self._ros = ros
        self._writer: Any = Writer(stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="stepbus")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def add(self, topic: str, type_name: str, message: Any, t_ns: int) -> None:
        """Write a message. t_ns: [ns]."""
        if topic not in self._channels:
            self._channels[topic] = self._channel(topic, type_name)
        count = self._counts[topic] = self._counts.get(topic, -1) + 1
        data = self._ros.bytes_of(type_name, message)
        self._writer.add_message(self._channels[topic], t_ns, data, t_ns, count)

    def _channel(self, topic: str, type_name: str) -> int:
        if type_name not in self._schemas:
            definition = self._ros.definition(type_name)
            schema = self._writer.register_schema(type_name, "ros2msg", definition)
            self._schemas[type_name] = schema
        is_kept = topic == "/tf_static" or topic.endswith("robot_description")
        metadata = {"offered_qos_profiles": _KEPT if is_kept else ""}
        number: int = self._writer.register_channel(
            topic, "cdr", self._schemas[type_name], metadata
        )
        return number

    def close(self) -> None:
        self._writer.finish()


def _array(values: Any) -> Any:
    return np.array(() if values is None else values, dtype=np.float64)


def _joint_state(ros: _Ros, moment: Moment) -> Converted:
    state = moment.message
    if isinstance(state, JointState | JointReference):
        yield ros.row(
            "sensor_msgs/msg/JointState",
            header=ros.header(moment.t_ns, ""),
            name=list(moment.port.names),
            position=_array(state.position),
            velocity=_array(state.velocity),
            effort=_array(state.effort if isinstance(state, JointState) else None),
        )


def _odometry(ros: _Ros, moment: Moment) -> Converted:
    state = moment.message
    if not isinstance(state, BaseState):
        return
    turn = (0.0, 0.0, np.sin(state.yaw / 2), np.cos(state.yaw / 2))
    pose = ros.make(
        "geometry_msgs/msg/Pose",
        position=ros.vector((state.x, state.y, 0.0), "Point"),
        orientation=ros.quaternion(turn),
    )
    twist = ros.make(
        "geometry_msgs/msg/Twist",
        linear=ros.vector((state.vx, 0.0, 0.0)),
        angular=ros.vector((0.0, 0.0, state.wz)),
    )
    unknown = np.zeros(36)
    yield ros.row(
        "nav_msgs/msg/Odometry",
        header=ros.header(moment.t_ns, "odom"),
        child_frame_id="base_link",
        pose=ros.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
        twist=ros.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )


def _image(ros: _Ros, moment: Moment) -> Converted:
    image = moment.message
    if not isinstance(image, Image):
        return
    header = ros.header(moment.t_ns, f"{moment.port.participant}/{moment.port.name}")
    depth = 3 if image.encoding == "rgb8" else 4
    yield ros.row(
        "sensor_msgs/msg/Image",
        header=header,
        height=image.height,
        width=image.width,
        encoding=image.encoding,
        is_bigendian=0,
        step=depth * image.width,
        data=np.frombuffer(image.data, np.uint8),
    )
    (fx, fy), (cx, cy) = image.focal, image.centre
    yield ros.row(
        "sensor_msgs/msg/CameraInfo",
        "/camera_info",
        header=header,
        height=image.height,
        width=image.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array((fx, 0, cx, 0, fy, cy, 0, 0, 1), dtype=float),
        r=np.eye(3).ravel(),
        p=np.array((fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0), dtype=float),
        binning_x=0,
        binning_y=0,
        roi=ros.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False,
        ),
    )  # fmt: skip


def _frame(port: Port) -> str:
    """Return the link that a sensor is on, as far as its port says."""
    return str(next(iter(port.names), "")) or f"{port.participant}/{port.name}"


def _imu(ros: _Ros, moment: Moment) -> Converted:
    imu = moment.message
    if not isinstance(imu, Imu):
        return
    # A covariance of -1 at its start says that there is no orientation.
    unknown = np.zeros(9)
    absent = np.array((-1.0, *unknown[1:]))
    yield ros.row(
        "sensor_msgs/msg/Imu",
        header=ros.header(moment.t_ns, _frame(moment.port)),
        orientation=ros.quaternion(imu.orientation or (0, 0, 0, 1)),
        orientation_covariance=unknown if imu.orientation else absent,
        angular_velocity=ros.vector(imu.angular_velocity),
        angular_velocity_covariance=unknown,
        linear_acceleration=ros.vector(imu.linear_acceleration),
        linear_acceleration_covariance=unknown,
    )


def _wrench(ros: _Ros, moment: Moment) -> Converted:
    found = moment.message
    if isinstance(found, Wrench):
        wrench = ros.make(
            "geometry_msgs/msg/Wrench",
            force=ros.vector(found.force),
            torque=ros.vector(found.torque),
        )
        header = ros.header(moment.t_ns, _frame(moment.port))
        yield ros.row("geometry_msgs/msg/WrenchStamped", header=header, wrench=wrench)


def _scan(ros: _Ros, moment: Moment) -> Converted:
    scan = moment.message
    if not isinstance(scan, LaserScan):
        return
    count = len(scan.ranges)
    yield ros.row(
        "sensor_msgs/msg/LaserScan",
        header=ros.header(moment.t_ns, _frame(moment.port)),
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + max(0, count - 1) * scan.angle_increment,
        angle_increment=scan.angle_increment,
        time_increment=0.0,
        scan_time=0.0,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=np.array(scan.ranges, np.float32),
        intensities=np.array(scan.intensities, np.float32),
    )


def _text(ros: _Ros, moment: Moment) -> Converted:
    found: Message = moment.message
    name = "std_msgs/msg/String"
    if isinstance(found, Event):
        yield ros.row(name, data=f"{found.level}: {found.text}")
    elif isinstance(found, TextMessage):
        yield ros.row(name, data=found.text)


_CONVERTERS: Mapping[str, Callable[[_Ros, Moment], Converted]] = {
    "BaseState/1": _odometry,
    "Event/1": _text,
    "Image/1": _image,
    "Imu/1": _imu,
    "JointReference/1": _joint_state,
    "JointState/1": _joint_state,
    "LaserScan/1": _scan,
    "Text/1": _text,
    "Wrench/1": _wrench,
}
