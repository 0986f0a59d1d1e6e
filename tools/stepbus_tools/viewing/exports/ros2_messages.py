"""From messages of stepbus to those of ROS 2, as nested maps of their fields."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from stepbus_participant import parse_duration
from stepbus_tools.viewing.exports.exporter import NS, Instant
from stepbus_tools.viewing.scene.pose import about, from_xyzw
from stepbus_tools.viewing.scene.scene import Scene, positions_in

from .frames import FrameTree, Transform

_UNKNOWN = 1e12
"""Variance where a recording does not say how good a value is: 0 would say that it is exact."""
_LEVELS = {"info": 20, "warning": 30, "error": 40}
"""As rcl_interfaces/msg/Log has them."""
_TRIANGLE_LIST = 11
_FLOAT32 = 7
"""As visualization_msgs/msg/Marker and sensor_msgs/msg/PointField have them."""

Fields = Mapping[str, Any]
"""Field → its value; what is left out is zero or empty."""


def transforms(placed: Iterable[Transform], t_ns: int) -> Fields:
    """Return frames in their parents at a time [ns]."""
    return {
        "transforms": [
            {
                "header": header(t_ns, row.parent),
                "child_frame_id": row.child,
                "transform": {
                    "translation": named("xyz", row.pose.position),
                    "rotation": named("wxyz", row.pose.wxyz),
                },
            }
            for row in placed
        ]
    }


def stamp(t_ns: int) -> Fields:
    """Return a time [ns] as ROS has it."""
    return {"sec": t_ns // NS, "nanosec": t_ns % NS}


def header(t_ns: int, frame: str) -> Fields:
    """Return a header of a frame at a time [ns]."""
    return {"stamp": stamp(t_ns), "frame_id": frame}


def _measured_by(tree: FrameTree, instant: Instant) -> Fields:
    """Return the header of a measurement, stamped with the time of the exposure."""
    latency = instant.port.description.details.get("latency")
    measured_ns = instant.t_ns - (parse_duration(latency[0]) if latency else 0)
    return header(measured_ns, tree.sensor_frame(instant.port))


def named(names: str, values: Iterable[float]) -> Fields:
    """Return numbers by the letters that stand for them."""
    return dict(zip(names, map(float, values), strict=True))


def _command(_: FrameTree, instant: Instant) -> Fields | None:
    """Return a command in the field of its mode; None where it has no values."""
    command: Any = instant.message
    field = {"torque": "effort", "velocity": "velocity", "brake": ""}.get(command.mode, "position")
    if not field:
        return None
    fields = {"header": header(instant.t_ns, ""), "name": list(instant.port.names)}
    if field == "position" and command.velocity is not None:
        fields["velocity"] = command.velocity
    return {**fields, field: command.values}


def _joints(_: FrameTree, instant: Instant) -> Fields:
    return {
        "header": header(instant.t_ns, ""),
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
        "position": named("xyz", (state.x, state.y, 0.0)),
        "orientation": named("wxyz", about((0.0, 0.0, 1.0), state.yaw)),
    }
    twist = {
        "linear": named("xyz", (state.vx, 0.0, 0.0)),
        "angular": named("xyz", (0.0, 0.0, state.wz)),
    }
    return {
        "header": header(instant.t_ns, parent),
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
        "orientation": named("xyzw", imu.orientation or (0, 0, 0, 1)),
        "orientation_covariance": absent,
        "angular_velocity": named("xyz", imu.angular_velocity),
        "linear_acceleration": named("xyz", imu.linear_acceleration),
    }


def _wrench(tree: FrameTree, instant: Instant) -> Fields:
    message: Any = instant.message
    wrench = {"force": named("xyz", message.force), "torque": named("xyz", message.torque)}
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


def _twist(_: FrameTree, instant: Instant) -> Fields | None:
    """Return a base command as Twist fields; None for a command to the wheels."""
    command: Any = instant.message
    if command.wheels is not None:
        return None
    return {
        "linear": named("xyz", (command.vx, 0.0, 0.0)),
        "angular": named("xyz", (0.0, 0.0, command.wz)),
    }


def _poses(tree: FrameTree, instant: Instant) -> Fields:
    """Return poses in the world, or in the frame that their message names."""
    message: Any = instant.message
    frame = getattr(message, "frame", "")
    rows = zip(message.position, message.orientation, strict=False)
    return {
        "header": header(instant.t_ns, tree.frame_of(frame) if frame else tree.world),
        "poses": [{"position": named("xyz", p), "orientation": named("xyzw", q)} for p, q in rows],
    }


def _placed(tree: FrameTree, instant: Instant) -> Fields:
    """Return transforms between frames that a participant names."""
    message: Any = instant.message
    rows = zip(
        message.parents, message.children, message.position, message.orientation, strict=False
    )
    placed = (
        Transform(tree.frame_of(parent), tree.frame_of(child), from_xyzw(p, q))
        for parent, child, p, q in rows
    )
    return transforms(placed, instant.t_ns)


def _cloud(tree: FrameTree, instant: Instant) -> Fields | None:
    """Return points, with their colours where they have some; None where bytes are missing."""
    cloud: Any = instant.message
    points = np.frombuffer(cloud.points, "<f4")
    colors = np.frombuffer(cloud.colours or b"", np.uint8)
    if len(points) != 3 * cloud.count or len(colors) not in (0, 3 * cloud.count):
        return None
    columns = ["x", "y", "z", *(["rgb"] if len(colors) else [])]
    data = points.reshape(-1, 3)
    if len(colors):
        packed = colors.reshape(-1, 3).astype("<u4") @ np.array((1 << 16, 1 << 8, 1), "<u4")
        data = np.column_stack((data, packed.astype("<u4").view("<f4")))
    return {
        "header": _measured_by(tree, instant),
        "height": 1,
        "width": cloud.count,
        "fields": [
            {"name": name, "offset": 4 * number, "datatype": _FLOAT32, "count": 1}
            for number, name in enumerate(columns)
        ],
        "point_step": 4 * len(columns),
        "row_step": 4 * len(columns) * cloud.count,
        "data": np.frombuffer(np.ascontiguousarray(data).tobytes(), np.uint8),
        "is_dense": bool(np.isfinite(points).all()),
    }


def _numbers(_: FrameTree, instant: Instant) -> Fields:
    """Return numbers, and the names that they have."""
    message: Any = instant.message
    count = len(message.values)
    names = ",".join(instant.port.names)
    return {
        "layout": {"dim": [{"label": names, "size": count, "stride": count}]},
        "data": message.values,
    }


def _trajectory(_: FrameTree, instant: Instant) -> Fields | None:
    """Return a planned path; None for an answer that there is none."""
    plan: Any = instant.message
    if not plan.times:
        return None
    velocities = plan.velocity or [None] * len(plan.times)
    rows = zip(plan.times, plan.position, velocities, strict=False)
    return {
        "header": header(instant.t_ns, ""),
        "joint_names": list(instant.port.names),
        "points": [
            {
                "positions": q,
                "velocities": v,
                "time_from_start": stamp(round(t * NS)),
            }
            for t, q, v in rows
        ],
    }


def _log(_: FrameTree, instant: Instant) -> Fields:
    """Return an event as nodes log it."""
    event: Any = instant.message
    return {
        "stamp": stamp(instant.t_ns),
        "level": _LEVELS[event.level],
        "name": instant.port.participant,
        "msg": event.text,
    }


def _data(field: str) -> Callable[[FrameTree, Instant], Fields]:
    """Return a converter that copies one field as `data`."""
    return lambda _, instant: {"data": getattr(instant.message, field)}


def markers(scene: Scene, tree: FrameTree) -> Fields:
    """Return the triangles of each body in its frame, as MarkerArray fields."""
    rows: list[Fields] = []
    for frame in scene.frames:
        for visual in () if frame.is_ghost else frame.visuals:
            red, green, blue = (value / 255 for value in visual.shown_color)
            corners = visual.mesh.vertices[visual.mesh.faces].reshape(-1, 3)
            rows.append(
                {
                    "header": header(0, tree.frame_of(frame.name)),
                    "ns": "scene",
                    "id": len(rows),
                    "type": _TRIANGLE_LIST,
                    "pose": {
                        "position": named("xyz", visual.pose.position),
                        "orientation": named("wxyz", visual.pose.wxyz),
                    },
                    "scale": named("xyz", (1, 1, 1)),
                    "color": named("rgba", (red, green, blue, 1)),
                    "frame_locked": True,
                    "points": [named("xyz", corner) for corner in corners.tolist()],
                }
            )
    return {"markers": rows}


class Row(NamedTuple):
    """What becomes of a message. topic: {} stands for that of its port.

    fields: of the message; None: nothing becomes of it.
    """

    topic: str
    type: str
    fields: Callable[[FrameTree, Instant], Fields | None]


_STATES = Row("{}", "sensor_msgs/msg/JointState", _joints)
_PLACES = Row("{}", "geometry_msgs/msg/PoseArray", _poses)
CONVERTED: Mapping[str, Sequence[Row]] = {
    "BaseCommand/1": [Row("{}", "geometry_msgs/msg/Twist", _twist)],
    "BaseState/1": [Row("{}", "nav_msgs/msg/Odometry", _odometry)],
    "Detections/1": [_PLACES],
    "EmergencyStop/1": [Row("{}", "std_msgs/msg/Bool", _data("active"))],
    "Event/1": [Row("/rosout", "rcl_interfaces/msg/Log", _log)],
    "GripperState/1": [_STATES],
    "Image/1": [
        # As image_transport and its viewers look for them.
        Row("{}/image_raw", "sensor_msgs/msg/Image", _image),
        Row("{}/camera_info", "sensor_msgs/msg/CameraInfo", _camera_info),
    ],
    "Imu/1": [Row("{}", "sensor_msgs/msg/Imu", _imu)],
    "JointCommand/1": [Row("{}", "sensor_msgs/msg/JointState", _command)],
    "JointReference/1": [_STATES],
    "JointState/1": [_STATES],
    "LaserScan/1": [Row("{}", "sensor_msgs/msg/LaserScan", _scan)],
    "Plan/1": [Row("{}", "trajectory_msgs/msg/JointTrajectory", _trajectory)],
    "PointCloud/1": [Row("{}", "sensor_msgs/msg/PointCloud2", _cloud)],
    "Poses/1": [_PLACES],
    "Scalars/1": [Row("{}", "std_msgs/msg/Float64MultiArray", _numbers)],
    "Text/1": [Row("{}", "std_msgs/msg/String", _data("text"))],
    "Transforms/1": [Row("{}", "tf2_msgs/msg/TFMessage", _placed)],
    "Wrench/1": [Row("{}", "geometry_msgs/msg/WrenchStamped", _wrench)],
}
"""Message type → the ROS 2 messages that it becomes."""
