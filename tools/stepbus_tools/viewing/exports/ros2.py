"""A recording as an MCAP file of ROS 2: `ros2 bag` and rosbags read it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from stepbus_orchestrator.recording import Port, Recording
from stepbus_participant import need
from stepbus_schemas import (
    BaseState,
    Event,
    GripperState,
    Image,
    Imu,
    JointReference,
    JointState,
    LaserScan,
    Message,
    TextMessage,
    Wrench,
)
from stepbus_tools.viewing.exports.export_files import Exported, Reached
from stepbus_tools.viewing.scene import Latest, Pose, about, build_scene, measured
from stepbus_tools.whole_file import replaced

from .frames import FrameTree, Transform
from .moments import NS, Moment, Rate, instants, readable

_TF_HZ = 50
_UNKNOWN = 1e12
"""Variance where a recording does not say how good a value is: 0 would say that it is exact."""
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
    texts; the frames as /tf, fifty times a second, and /tf_static; the robots' descriptions.

    Raises RecordingFailed when nothing can be exported or the file cannot be written, ExtraMissing
    without the library.
    """
    lost: dict[str, str] = {}
    ports = readable(recording, lost)
    scene = build_scene(recording.path, recording.ports, recording.attachments)
    tree = FrameTree(scene, ports)
    ros = _Ros(tree)
    wanted = [p for p in ports if p.type in _CONVERTERS or p.topic in scene.topics]
    left = [f"{p.topic} ({p.type})" for p in ports if p not in wanted]
    rate, latest = Rate(_TF_HZ), dict[str, Latest]()
    with replaced(target) as path, path.open("wb") as stream:
        bag = _Bag(stream, ros)
        for topic, text in _descriptions(tree):
            bag.add(topic, "std_msgs/msg/String", ros.make("std_msgs/msg/String", data=text), 0)
        bag.add("/tf_static", _TF, ros.transforms(tree.still(), 0), 0)
        for t_ns, group in instants(recording, wanted, lost, reached):
            topics = [moment.port.topic for moment in group]
            latest |= {m.port.topic: Latest(step=m.step, message=m.message) for m in group}
            due = frozenset(topic for topic in topics if rate.passes(topic, t_ns))
            if moved := list(tree.moved(due, latest)):
                bag.add("/tf", _TF, ros.transforms(moved, t_ns), t_ns)
            for moment in group:
                convert = _CONVERTERS.get(moment.port.type)
                for suffix, type_name, message in convert(ros, moment) if convert else ():
                    bag.add(_topic(moment.port, suffix), type_name, message, t_ns)
        bag.close()
    unknown = [f"ROS 2 has no type for {', '.join(left)}: left out"] if left else []
    problems = [*scene.notes, *unknown, *lost.values()]
    return Exported(paths=[target], problems=problems, lost=list(lost))


def _descriptions(tree: FrameTree) -> Iterator[tuple[str, str]]:
    """Yield topic and URDF of each robot; the only one has the usual topic."""
    for robot in tree.robots:
        yield f"/{robot.prefix}robot_description", robot.body.model.text


def _topic(port: Port, suffix: str) -> str:
    return f"/{port.participant}/{port.name}{suffix}".replace("-", "_")


_TF = "tf2_msgs/msg/TFMessage"
Converted = Iterator[tuple[str, str, Any]]
"""End of the topic, type and message."""


class _Ros:
    """The message types of ROS 2, and what makes their parts."""

    def __init__(self, tree: FrameTree) -> None:
        self.tree = tree
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

    def pose(self, pose: Pose) -> Any:
        w, x, y, z = pose.wxyz
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.vector(pose.position, "Point"),
            orientation=self.quaternion((x, y, z, w)),
        )

    def transforms(self, placed: Iterable[Transform], t_ns: int) -> Any:
        return self.make(_TF, transforms=[self._transform(row, t_ns) for row in placed])

    def _transform(self, row: Transform, t_ns: int) -> Any:
        w, x, y, z = row.pose.wxyz
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(t_ns, row.parent),
            child_frame_id=row.child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.vector(row.pose.position),
                rotation=self.quaternion((x, y, z, w)),
            ),
        )


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
    elif isinstance(state, GripperState):
        yield ros.row(
            "sensor_msgs/msg/JointState",
            header=ros.header(moment.t_ns, ""),
            name=list(moment.port.names),
            position=_array(measured(state)),
            velocity=_array(None),
            effort=_array(None),
        )


def _odometry(ros: _Ros, moment: Moment) -> Converted:
    state = moment.message
    if not isinstance(state, BaseState):
        return
    parent, child = ros.tree.base_of(moment.port)
    turn = about((0.0, 0.0, 1.0), state.yaw)
    pose = ros.pose(Pose((state.x, state.y, 0.0), turn))
    twist = ros.make(
        "geometry_msgs/msg/Twist",
        linear=ros.vector((state.vx, 0.0, 0.0)),
        angular=ros.vector((0.0, 0.0, state.wz)),
    )
    covariance = _UNKNOWN * np.eye(6).ravel()
    yield ros.row(
        "nav_msgs/msg/Odometry",
        header=ros.header(moment.t_ns, parent),
        child_frame_id=child,
        pose=ros.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        twist=ros.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
    )


def _image(ros: _Ros, moment: Moment) -> Converted:
    image = moment.message
    if not isinstance(image, Image):
        return
    header = ros.header(moment.t_ns, ros.tree.sensor_frame(moment.port))
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


def _imu(ros: _Ros, moment: Moment) -> Converted:
    imu = moment.message
    if not isinstance(imu, Imu):
        return
    # In this type, zeros say that a covariance is unknown, and -1 that there is no orientation.
    unknown = np.zeros(9)
    absent = np.array((-1.0, *unknown[1:]))
    yield ros.row(
        "sensor_msgs/msg/Imu",
        header=ros.header(moment.t_ns, ros.tree.sensor_frame(moment.port)),
        orientation=ros.quaternion(imu.orientation or (0, 0, 0, 1)),
        orientation_covariance=unknown if imu.orientation else absent,
        angular_velocity=ros.vector(imu.angular_velocity),
        angular_velocity_covariance=unknown,
        linear_acceleration=ros.vector(imu.linear_acceleration),
        linear_acceleration_covariance=unknown,
    )


def _wrench(ros: _Ros, moment: Moment) -> Converted:
    message = moment.message
    if isinstance(message, Wrench):
        wrench = ros.make(
            "geometry_msgs/msg/Wrench",
            force=ros.vector(message.force),
            torque=ros.vector(message.torque),
        )
        header = ros.header(moment.t_ns, ros.tree.sensor_frame(moment.port))
        yield ros.row("geometry_msgs/msg/WrenchStamped", header=header, wrench=wrench)


def _scan(ros: _Ros, moment: Moment) -> Converted:
    scan = moment.message
    if not isinstance(scan, LaserScan):
        return
    count = len(scan.ranges)
    yield ros.row(
        "sensor_msgs/msg/LaserScan",
        header=ros.header(moment.t_ns, ros.tree.sensor_frame(moment.port)),
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
    event: Message = moment.message
    name = "std_msgs/msg/String"
    if isinstance(event, Event):
        yield ros.row(name, data=f"{event.level}: {event.text}")
    elif isinstance(event, TextMessage):
        yield ros.row(name, data=event.text)


_CONVERTERS: Mapping[str, Callable[[_Ros, Moment], Converted]] = {
    "BaseState/1": _odometry,
    "Event/1": _text,
    "GripperState/1": _joint_state,
    "Image/1": _image,
    "Imu/1": _imu,
    "JointReference/1": _joint_state,
    "JointState/1": _joint_state,
    "LaserScan/1": _scan,
    "Text/1": _text,
    "Wrench/1": _wrench,
}
