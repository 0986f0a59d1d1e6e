"""Exports for ROS 2, read back by what did not write them."""

import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability as Qos
from rosbags.rosbag2 import Reader
from support.messages.recordings import write

from stepbus_orchestrator.cli.entry import main
from stepbus_schemas import (
    BaseState,
    ControllerStatus,
    Description,
    Event,
    Image,
    Imu,
    JointCommand,
    JointState,
    Plan,
    PointCloud,
    Poses,
    Scalars,
)

STEPS = 200
SHAPES = {"shape": ["box 0.4 0.2 0.2"], "color": ["0.8 0.1 0.1"], "body": ["crate"]}
CLOUD = PointCloud(
    count=2,
    points=np.arange(1, 7, dtype="<f4").tobytes(),
    colours=bytes((0xFF, 0x80, 0x00, 0x00, 0x01, 0x02)),
)
PLAN = Plan(id=1, times=[0.0, 1.5], position=[[0.0, 0.0], [1.0, 1.0]], velocity=[[0.0, 0.0]] * 2)
PIXELS = np.arange(4 * 2 * 3, dtype=np.uint8).reshape(2, 4, 3)


def joints(step):
    return JointState(position=[math.sin(step / 20), 0.5], velocity=[0.25, 0.0])


def poses(step):
    return Poses(position=[(step * 0.01, 0.0, 0.5)], orientation=[(0.0, 0.0, 0.0, 1.0)])


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    image = Image(
        width=4, height=2, encoding="rgb8", data=PIXELS.tobytes(), focal=(4.0, 5.0), centre=(2.0, 1.0)
    )  # fmt: skip
    base = BaseState(x=1.0, y=2.0, yaw=math.pi / 2, vx=0.3, wz=0.1)
    imu = Imu(angular_velocity=(0.1, 0.2, 0.3), linear_acceleration=(0.0, 0.0, 9.81))
    return write(
        tmp_path_factory.mktemp("formats") / "run.mcap",
        5_000_000,
        joint_state=("JointState/1", ["hip", "knee"], [joints(step) for step in range(STEPS)]),
        odometry=("BaseState/1", [], [base] * STEPS),
        camera=("Image/1", [], [image] * 3),
        late=("Image/1", Description(details={"latency": ["5ms"]}), [None, image]),
        imu=("Imu/1", [], [imu] * 3),
        poses=(
            "Poses/1", Description(names=["crate"], details=SHAPES),
            [poses(step) for step in range(STEPS)],
        ),
        events=("Event/1", [], [None, Event(level="warning", text="slow")]),
        volts=("Scalars/1", ["left"], [Scalars(values=[12.0])]),
        points=("PointCloud/1", [], [CLOUD]),
        command=("JointCommand/1", ["hip", "knee"], [JointCommand(mode="torque", values=[1.5, 2.5])]),
        plan=("Plan/1", ["hip", "knee"], [PLAN]),
        status=("ControllerStatus/1", ["hip"], [ControllerStatus(error=[0.1], saturated=[False])]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def bag(recording):
    target = recording.with_name("ros2.mcap")
    assert main(["export", str(recording), "--ros2", str(target)]) == 0
    with AnyReader([target]) as reader:
        found = {}
        for connection, t_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault((connection.topic, connection.msgtype), []).append((t_ns, message))
        return found


def test_rosbags_reads_joints_and_odometry_with_every_digit(bag):
    states = bag["/plant/joint_state", "sensor_msgs/msg/JointState"]
    assert [m.position[0] for _, m in states] == [math.sin(step / 20) for step in range(STEPS)]
    assert states[0][1].name == ["hip", "knee"]
    t_ns, last = states[-1]
    assert (t_ns, last.header.stamp.nanosec) == (995_000_000, 995_000_000)
    (_, odometry), *_ = bag["/plant/odometry", "nav_msgs/msg/Odometry"]
    assert odometry.pose.pose.position.y == 2.0
    assert odometry.pose.pose.orientation.z == pytest.approx(math.sqrt(0.5))
    assert odometry.twist.twist.linear.x == 0.3


def test_rosbags_reads_images_inertial_units_and_texts(bag):
    (_, image), *_ = bag["/plant/camera/image_raw", "sensor_msgs/msg/Image"]
    assert (image.encoding, image.step) == ("rgb8", 12)
    assert image.data.tobytes() == PIXELS.tobytes()
    ((t_ns, late),) = bag["/plant/late/image_raw", "sensor_msgs/msg/Image"]
    assert (t_ns, late.header.stamp.nanosec) == (5_000_000, 0)
    (_, info), *_ = bag["/plant/camera/camera_info", "sensor_msgs/msg/CameraInfo"]
    assert list(info.k) == [4, 0, 2, 0, 5, 1, 0, 0, 1]
    (_, imu), *_ = bag["/plant/imu", "sensor_msgs/msg/Imu"]
    assert imu.linear_acceleration.z == 9.81
    assert imu.orientation_covariance[0] == -1
    ((t_ns, log),) = bag["/rosout", "rcl_interfaces/msg/Log"]
    assert (log.level, log.name, log.msg) == (log.WARN, "plant", "slow")
    assert (log.stamp.sec, log.stamp.nanosec) == (0, t_ns)


def test_frames_move_fifty_times_a_second(bag):
    frames = bag["/tf", "tf2_msgs/msg/TFMessage"]
    assert 45 <= len(frames) <= 51
    (transform,) = frames[-1][1].transforms
    assert transform.header.frame_id == "map"
    t_ns, x = frames[-1][0], transform.transform.translation.x
    assert x == pytest.approx(t_ns / 5_000_000 * 0.01)


def test_points_commands_numbers_and_plans_have_the_types_of_ros2(bag):
    (_, cloud), *_ = bag["/plant/points", "sensor_msgs/msg/PointCloud2"]
    (first, second) = rosbags_points(cloud)
    assert first == (1.0, 2.0, 3.0, 0xFF8000)
    assert second == (4.0, 5.0, 6.0, 0x000102)
    (_, command), *_ = bag["/plant/command", "sensor_msgs/msg/JointState"]
    assert (list(command.effort), len(command.position)) == ([1.5, 2.5], 0)
    (_, volts), *_ = bag["/plant/volts", "std_msgs/msg/Float64MultiArray"]
    assert (list(volts.data), volts.layout.dim[0].label) == ([12.0], "left")
    (_, plan), *_ = bag["/plant/plan", "trajectory_msgs/msg/JointTrajectory"]
    assert plan.joint_names == ["hip", "knee"]
    start = plan.points[1].time_from_start
    assert (start.sec, start.nanosec) == (1, 500_000_000)


def rosbags_points(cloud):
    """The points of a PointCloud2, as its own fields describe them."""
    fields = {f.name: (f.offset, "<u4" if f.name == "rgb" else "<f4") for f in cloud.fields}
    row = np.dtype(
        {
            "names": list(fields),
            "offsets": [offset for offset, _ in fields.values()],
            "formats": [form for _, form in fields.values()],
            "itemsize": cloud.point_step,
        }
    )
    return np.frombuffer(cloud.data.tobytes(), row).tolist()


def test_the_scene_needs_no_mesh_files_and_the_clock_runs(bag):
    ((_, scene),) = bag["/scene", "visualization_msgs/msg/MarkerArray"]
    (crate,) = scene.markers
    assert crate.type == crate.TRIANGLE_LIST
    assert len(crate.points) == 36
    assert max(point.x for point in crate.points) == pytest.approx(0.2)
    assert crate.header.frame_id in {
        row.child_frame_id for _, m in bag["/tf", "tf2_msgs/msg/TFMessage"] for row in m.transforms
    }
    clock = [
        m.clock.sec * 10**9 + m.clock.nanosec for _, m in bag["/clock", "rosgraph_msgs/msg/Clock"]
    ]
    assert clock == [20_000_000 * n for n in range(50)]


def test_a_folder_is_a_bag_with_metadata_and_late_subscribers_get_what_stands_still(
    recording, tmp_path, capsys
):
    assert main(["export", str(recording), "--ros2", str(tmp_path / "bag")]) == 0
    assert "ROS 2 has no type for plant/status" in capsys.readouterr().err
    assert {path.name for path in (tmp_path / "bag").iterdir()} == {"bag_0.mcap", "metadata.yaml"}
    about = yaml.safe_load((tmp_path / "bag/metadata.yaml").read_text())
    about = about["rosbag2_bagfile_information"]
    with Reader(tmp_path / "bag") as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        kept = {c.topic for c in reader.connections if is_kept(c)}
        read = Counter(connection.topic for connection, *_ in reader.messages())
    assert read == counts
    assert about["message_count"] == read.total()
    assert kept == {"/tf_static", "/scene"}
    # The file alone says the same, as rosbag2 needs it.
    with (tmp_path / "bag/bag_0.mcap").open("rb") as file:
        (inside,) = [m for m in make_reader(file).iter_metadata() if m.name == "rosbag2"]
    assert yaml.safe_load(inside.metadata["serialized_metadata"]) == about


def is_kept(connection):
    (profile,) = connection.ext.offered_qos_profiles
    return profile.durability == Qos.TRANSIENT_LOCAL


def test_what_foxglove_opens_is_the_bag(bag, recording, tmp_path):
    target = tmp_path / "ros2.mcap"
    assert main(["export", str(recording), "--foxglove", str(target)]) == 0
    assert target.read_bytes() == recording.with_name("ros2.mcap").read_bytes()


@pytest.mark.parametrize("form", ["ros2", "csv", "parquet"])
def test_half_a_recording_is_exported_and_a_foreign_file_is_one_sentence(
    recording, tmp_path, capsys, form
):
    data = recording.read_bytes()
    half = tmp_path / "half.mcap"
    half.write_bytes(data[: len(data) // 2])
    assert main(["export", str(half), f"--{form}", str(tmp_path / "a.mcap")]) == 0
    assert "is damaged" in capsys.readouterr().err
    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    assert main(["export", str(text), f"--{form}", str(tmp_path / "b.mcap")]) != 0
    assert capsys.readouterr().err.count("\n") == 1
    empty = write(tmp_path / "empty.mcap", joint_state=("JointState/1", ["hip"], []))
    assert main(["export", str(empty), f"--{form}", str(tmp_path / "b.mcap")]) != 0
    assert "has no message that can be exported" in capsys.readouterr().err
    assert not list(Path(tmp_path).glob("*b.mcap*"))


@pytest.mark.parametrize(
    "words",
    [
        *(["export", f"--{form}=out"] for form in ("csv", "parquet", "ros2")),
        ["export", "--video=out.mp4"],
        ["export", "--scene=out.html"],
        ["report"],
        ["view", "--no-open"],
    ],
)
def test_a_recording_of_another_system_is_one_sentence(
    bag, recording, tmp_path, capsys, monkeypatch, words
):
    monkeypatch.chdir(tmp_path)
    foreign = recording.with_name("ros2.mcap")
    assert main([words[0], str(foreign), *words[1:]]) == 8
    error = capsys.readouterr().err
    assert error.startswith(f"stepbus: {foreign} is not from stepbus, or from a newer version: ")
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_times_are_exact_after_52_days(tmp_path):
    hours = [None, *[None] * 2076, Event(level="info", text="late")]
    path = write(tmp_path / "run.mcap", 3600 * 10**9, events=("Event/1", [], hours))
    assert main(["export", str(path), "--ros2", str(tmp_path / "out.mcap")]) == 0
    with (tmp_path / "out.mcap").open("rb") as file:
        times = {message.log_time for _, _, message in make_reader(file).iter_messages()}
    assert max(times) == 2077 * 3600 * 10**9


def test_a_point_of_a_path_just_before_a_second_is_not_a_second_early(tmp_path):
    plan = Plan(id=1, times=[0.0, 0.9999999999], position=[[0.0], [1.0]])
    path = write(tmp_path / "run.mcap", plan=("Plan/1", ["hip"], [plan]))
    assert main(["export", str(path), "--ros2", str(tmp_path / "bag")]) == 0
    with AnyReader([tmp_path / "bag"]) as reader:
        connection = next(c for c in reader.connections if "JointTrajectory" in c.msgtype)
        _, _, data = next(reader.messages([connection]))
        late = reader.deserialize(data, connection.msgtype).points[1].time_from_start
    assert (late.sec, late.nanosec) == (1, 0)


def test_topics_of_ros2_are_legal_and_differ(tmp_path, capsys):
    """A legal topic is as https://design.ros2.org/articles/topic_and_service_names.html says."""
    ports = {
        name: ("Scalars/1", ["x"], [Scalars(values=[float(number)])])
        for number, name in enumerate(("a-b", "a_b", "2nd", "plain"))
    }
    path = write(tmp_path / "run.mcap", **ports)
    assert main(["export", str(path), "--ros2", str(tmp_path / "bag")]) == 0
    with AnyReader([tmp_path / "bag"]) as reader:
        values = {
            connection.topic: reader.deserialize(data, connection.msgtype).data[0]
            for connection, _, data in reader.messages()
            if connection.topic.startswith("/plant")
        }
    assert all(re.fullmatch(r"(/[A-Za-z_]\w*)+", topic, re.ASCII) for topic in values)
    assert values == {"/plant/a_b_": 0, "/plant/a_b": 1, "/plant/_2nd": 2, "/plant/plain": 3}  # fmt: skip
    assert "/plant/a_b_, plant/2nd is /plant/_2nd" in capsys.readouterr().err
