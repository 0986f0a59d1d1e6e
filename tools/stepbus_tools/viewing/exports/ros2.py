"""A recording as an MCAP file of ROS 2: `ros2 bag` and rosbags read it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from stepbus_orchestrator.recording import Recording
from stepbus_participant import need
from stepbus_schemas import Event
from stepbus_tools.viewing.exports.exporter import Exported, Exporter, Reached
from stepbus_tools.viewing.scene.bodies import Latest, positions_in
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.pose import about
from stepbus_tools.whole_file import replaced

from .frames import FrameTree, Transform
from .instants import NS, Instant, Rate, instants, readable_ports

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
_STRING = "std_msgs/msg/String"
_TF = "tf2_msgs/msg/TFMessage"


def _export(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write the messages that ROS 2 has a type for.

    Joints, odometry, images with their camera info, inertial units, wrenches, laser scans and
    texts; the frames as /tf, fifty times a second, and /tf_static; the robots' descriptions.
    """
    ports, lost = readable_ports(recording)
    scene = build_scene(recording)
    tree = FrameTree(scene, ports)
    wanted = [p for p in ports if p.type in _CONVERTED or p.topic in scene.topics]
    left = [f"{p.topic} ({p.type})" for p in ports if p not in wanted]
    rate, latest = Rate(_TF_HZ), dict[str, Latest]()
    with replaced(target) as path, path.open("wb") as stream:
        bag = _Bag(stream)
        for robot in tree.robots:
            # The only one has the usual topic.
            text = {"data": robot.body.model.text}
            bag.add(f"/{robot.prefix}robot_description", _STRING, text, 0)
        bag.add("/tf_static", _TF, _transforms(tree.still(), 0), 0)
        for t_ns, group in instants(recording, wanted, lost, reached):
            topics = [instant.port.topic for instant in group]
            latest |= {i.port.topic: Latest(i.step, i.message) for i in group}
            due = frozenset(topic for topic in topics if rate.passes(topic, t_ns))
            if moved := list(tree.moved(due, latest)):
                bag.add("/tf", _TF, _transforms(moved, t_ns), t_ns)
            for instant in group:
                for suffix, type_name, convert in _CONVERTED.get(instant.port.type, ()):
                    topic = f"/{instant.port.topic}{suffix}".replace("-", "_")
                    bag.add(topic, type_name, convert(tree, instant), t_ns)
        bag.close()
    unknown = [f"ROS 2 has no type for {', '.join(left)}: left out"] if left else []
    problems = [*scene.notes, *unknown, *lost.values()]
    return Exported(paths=[target], problems=problems, lost=list(lost))


ROS2 = Exporter(
    write=_export, help="an .mcap that ros2 bag and rosbags read: joints, frames, odometry, images"
)


class _Bag:
    """The file. Channels are added when their first message comes."""

    def __init__(self, stream: Any) -> None:
        typesys, interfaces = need("the export for ROS 2", "rosbags.typesys", "rosbags.interfaces")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._kinds = interfaces.Nodetype
        self._writer: Any = Writer(stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="stepbus")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def add(self, topic: str, type_name: str, fields: Mapping[str, Any], t_ns: int) -> None:
        """Write a message, of nested maps; what is left out is zero or empty. t_ns: [ns]."""
        if topic not in self._channels:
            self._channels[topic] = self._channel(topic, type_name)
        count = self._counts[topic] = self._counts.get(topic, -1) + 1
        data = bytes(self._store.serialize_cdr(self._message(type_name, fields), type_name))
        self._writer.add_message(self._channels[topic], t_ns, data, t_ns, count)

    def _channel(self, topic: str, type_name: str) -> int:
        if type_name not in self._schemas:
            text, _ = self._store.generate_msgdef(type_name, ros_version=2)
            definition = str(text).encode()
            schema = self._writer.register_schema(type_name, "ros2msg", definition)
            self._schemas[type_name] = schema
        is_kept = topic == "/tf_static" or topic.endswith("robot_description")
        metadata = {"offered_qos_profiles": _KEPT if is_kept else ""}
        schema = self._schemas[type_name]
        number: int = self._writer.register_channel(topic, "cdr", schema, metadata)
        return number

    def _message(self, type_name: str, fields: Mapping[str, Any]) -> Any:
        _, kinds = self._store.fielddefs[type_name]
        values = {name: self._value(kind, fields.get(name)) for name, kind in kinds}
        return self._store.types[type_name](**values)

    def _value(self, kind: Any, value: Any) -> Any:
        form, what = kind
        if form == self._kinds.NAME:
            return self._message(what, value or {})
        if form == self._kinds.BASE:
            empty = "" if what[0] == "string" else 0
            return empty if value is None else value
        (inner, name), count = what
        if inner == self._kinds.NAME:
            return [self._message(name, one) for one in value or ()]
        if name[0] == "string":
            return value or []
        return np.zeros(count, name[0]) if value is None else np.asarray(value, name[0])

    def close(self) -> None:
        self._writer.finish()


Fields = Mapping[str, Any]


def _transforms(placed: Iterable[Transform], t_ns: int) -> Fields:
    return {
        "transforms": [
            {
                "header": _header(t_ns, row.parent),
                "child_frame_id": row.child,
                "transform": {
                    "translation": _named("xyz", row.pose.position),
                    "rotation": _named("wxyz", row.pose.wxyz),
                },
            }
            for row in placed
        ]
    }


def _header(t_ns: int, frame: str) -> Fields:
    return {"stamp": {"sec": t_ns // NS, "nanosec": t_ns % NS}, "frame_id": frame}


def _measured_by(tree: FrameTree, instant: Instant) -> Fields:
    """Return the header of what a sensor measures."""
    return _header(instant.t_ns, tree.sensor_frame(instant.port))


def _named(names: str, values: Iterable[float]) -> Fields:
    return dict(zip(names, map(float, values), strict=True))


def _joints(_: FrameTree, instant: Instant) -> Fields:
    return {
        "header": _header(instant.t_ns, ""),
        "name": list(instant.port.names),
        "position": positions_in(instant.message),
        "velocity": getattr(instant.message, "velocity", None),
        "effort": getattr(instant.message, "effort", None),
    }


def _odometry(tree: FrameTree, instant: Instant) -> Fields:
    state: Any = instant.message
    parent, child = tree.base_of(instant.port)
    covariance = _UNKNOWN * np.eye(6).ravel()
    pose = {
        "position": _named("xyz", (state.x, state.y, 0.0)),
        "orientation": _named("wxyz", about((0.0, 0.0, 1.0), state.yaw)),
    }
    twist = {
        "linear": _named("xyz", (state.vx, 0.0, 0.0)),
        "angular": _named("xyz", (0.0, 0.0, state.wz)),
    }
    return {
        "header": _header(instant.t_ns, parent),
        "child_frame_id": child,
        "pose": {"pose": pose, "covariance": covariance},
        "twist": {"twist": twist, "covariance": covariance},
    }


def _image(tree: FrameTree, instant: Instant) -> Fields:
    image: Any = instant.message
    return {
        "header": _measured_by(tree, instant),
        "height": image.height,
        "width": image.width,
        "encoding": image.encoding,
        "step": (3 if image.encoding == "rgb8" else 4) * image.width,
        "data": np.frombuffer(image.data, np.uint8),
    }


def _camera_info(tree: FrameTree, instant: Instant) -> Fields:
    image: Any = instant.message
    (fx, fy), (cx, cy) = image.focal, image.centre
    return {
        "header": _measured_by(tree, instant),
        "height": image.height,
        "width": image.width,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": (fx, 0, cx, 0, fy, cy, 0, 0, 1),
        "r": np.eye(3).ravel(),
        "p": (fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0),
    }


def _imu(tree: FrameTree, instant: Instant) -> Fields:
    imu: Any = instant.message
    # In this type, zeros say that a covariance is unknown, and -1 that there is no orientation.
    absent = None if imu.orientation else (-1.0, *np.zeros(8))
    return {
        "header": _measured_by(tree, instant),
        "orientation": _named("xyzw", imu.orientation or (0, 0, 0, 1)),
        "orientation_covariance": absent,
        "angular_velocity": _named("xyz", imu.angular_velocity),
        "linear_acceleration": _named("xyz", imu.linear_acceleration),
    }


def _wrench(tree: FrameTree, instant: Instant) -> Fields:
    message: Any = instant.message
    wrench = {"force": _named("xyz", message.force), "torque": _named("xyz", message.torque)}
    return {"header": _measured_by(tree, instant), "wrench": wrench}


def _scan(tree: FrameTree, instant: Instant) -> Fields:
    scan: Any = instant.message
    span = max(0, len(scan.ranges) - 1) * scan.angle_increment
    names = ("angle_min", "angle_increment", "range_min", "range_max", "ranges", "intensities")
    return {
        "header": _measured_by(tree, instant),
        "angle_max": scan.angle_min + span,
        **{name: getattr(scan, name) for name in names},
    }


def _text(_: FrameTree, instant: Instant) -> Fields:
    message: Any = instant.message
    level = f"{message.level}: " if isinstance(message, Event) else ""
    return {"data": f"{level}{message.text}"}


_JOINTS = ("", "sensor_msgs/msg/JointState", _joints)
_CONVERTED: Mapping[str, Sequence[tuple[str, str, Callable[[FrameTree, Instant], Fields]]]] = {
    "BaseState/1": [("", "nav_msgs/msg/Odometry", _odometry)],
    "Event/1": [("", _STRING, _text)],
    "GripperState/1": [_JOINTS],
    "Image/1": [
        ("", "sensor_msgs/msg/Image", _image),
        ("/camera_info", "sensor_msgs/msg/CameraInfo", _camera_info),
    ],
    "Imu/1": [("", "sensor_msgs/msg/Imu", _imu)],
    "JointReference/1": [_JOINTS],
    "JointState/1": [_JOINTS],
    "LaserScan/1": [("", "sensor_msgs/msg/LaserScan", _scan)],
    "Text/1": [("", _STRING, _text)],
    "Wrench/1": [("", "geometry_msgs/msg/WrenchStamped", _wrench)],
}
"""Type → end of the topic, type and fields of what becomes of a message."""
