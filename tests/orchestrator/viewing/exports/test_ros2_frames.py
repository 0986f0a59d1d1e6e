"""The frames of an export for ROS 2, against forward kinematics and the true poses of the plant."""

from dataclasses import dataclass, field
from importlib.resources import files

import numpy as np
import pinocchio as pin
import pytest
from rosbags.highlevel import AnyReader

import stepbus
from stepbus_orchestrator.cli.entry import main

TF = "tf2_msgs/msg/TFMessage"
TWO_ARMS = """
name: two_arms
step: 5ms
duration: 500ms
participants:
  plant:
    exec: [python, -m, stepbus_plant]
    outputs: {joint_state: JointState/1, poses: Poses/1}
    params: {world: world.yaml}
"""
WORLD = """
gravity: [0, 0, -9.81]
physics_step: 5ms
bodies:
  left: {urdf: arm.urdf, fixed_base: true, position: [0, 1, 0], joint_defaults: {mode: torque}}
  right:
    urdf: arm.urdf
    fixed_base: true
    position: [0, -1, 0]
    joint_defaults: {mode: torque}
    joints: {joint2: {position: 1.0}}
  table: {urdf: table.urdf, fixed_base: true, position: [2, 0, 0]}
"""
TABLE = """<robot name="table"><link name="top"/><link name="corner"/>
<joint name="edge" type="fixed"><parent link="top"/><child link="corner"/>
<origin xyz="0.5 0.5 0.1"/></joint></robot>"""


@dataclass
class Bag:
    """What rosbags reads. tf: time [ns] → frame → its parent, and its pose in it."""

    tf: dict = field(default_factory=dict)
    still: dict = field(default_factory=dict)
    texts: dict = field(default_factory=dict)
    frames: dict = field(default_factory=dict)
    joints: dict = field(default_factory=dict)

    def in_map(self):
        """Yield each time and frame → its pose in `map`, of all that are known by then."""
        newest = dict(self.still)
        for t_ns, placed in self.tf.items():
            newest |= placed
            yield t_ns, {name: chained(newest, name) for name in newest}


def chained(newest, name):
    pose = pin.SE3.Identity()
    while name != "map":
        name, step = newest[name]
        pose = step * pose
    return pose


def read(target):
    bag = Bag()
    with AnyReader([target]) as reader:
        for connection, t_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.msgtype == TF:
                rows = {row.child_frame_id: placed(row) for row in message.transforms}
                assert len(rows) == len(message.transforms)
                if connection.topic == "/tf":
                    bag.tf[t_ns] = rows
                else:
                    bag.still = rows
            elif connection.msgtype == "std_msgs/msg/String":
                bag.texts[connection.topic] = message.data
            else:
                child = getattr(message, "child_frame_id", "")
                bag.frames[connection.topic] = (message.header.frame_id, child)
            if connection.topic in {"/plant/joint_state", "/plant/gripper"}:
                found = dict(zip(message.name, message.position, strict=True))
                bag.joints.setdefault(t_ns, {}).update(found)
    return bag


def placed(row):
    t, q = row.transform.translation, row.transform.rotation
    rotation = pin.Quaternion(q.w, q.x, q.y, q.z).toRotationMatrix()
    return row.header.frame_id, pin.SE3(rotation, np.array([t.x, t.y, t.z]))


def kinematics(urdf, positions):
    """Return link → its pose in the root, by Pinocchio; joints that are not given rest at 0."""
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    q = pin.neutral(model)
    for name, value in positions.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    links = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
    return {frame.name: data.oMf[model.getFrameId(frame.name)] for frame in links}


def export(recording, target):
    assert main(["export", str(recording), "--ros2", str(target)]) == 0
    return read(target)


def agree(one, other, within):
    return np.allclose(one.homogeneous, other.homogeneous, atol=within)


@pytest.fixture(scope="module")
def two_arms(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two_arms")
    arm = files("stepbus_scenarios") / "two_link" / "two_link.urdf"
    (folder / "arm.urdf").write_bytes(arm.read_bytes())
    (folder / "world.yaml").write_text(WORLD)
    (folder / "table.urdf").write_text(TABLE)
    (folder / "scenario.yaml").write_text(TWO_ARMS)
    result = stepbus.run(folder / "scenario.yaml", out=folder / "run", in_process=True)
    return result.recording, export(result.recording, folder / "ros2.mcap")


def test_two_robots_of_one_model_have_frames_of_their_own(two_arms):
    _, bag = two_arms
    frames = {name for _, poses in bag.in_map() for name in poses}
    assert {"left/link1", "left/link2", "right/link1", "right/link2"} <= frames
    assert bag.texts.keys() == {"/left/robot_description", "/right/robot_description"}


def test_every_link_is_where_the_plant_has_it(two_arms):
    recording, bag = two_arms
    port = stepbus.Recording(recording)["plant.poses"]
    true = {step * 5_000_000: message for step, message in port.messages()}
    assert len(bag.tf) > 20
    for t_ns, poses in bag.in_map():
        for name, position in zip(port.names, true[t_ns].position, strict=True):
            assert np.allclose(poses[name].translation, position, atol=1e-6), (t_ns, name)


def test_links_that_never_move_are_static_and_have_their_place(two_arms):
    _, bag = two_arms
    assert not bag.still.keys() & {name for placed in bag.tf.values() for name in placed}
    _, poses = next(bag.in_map())
    corner = next(pose for name, pose in poses.items() if name.endswith("corner"))
    assert np.allclose(corner.translation, [2.5, 0.5, 0.1])


def test_a_robot_alone_has_the_names_of_its_model(tmp_path):
    result = stepbus.run("two_link", set=["duration=500ms"], out=tmp_path / "run", in_process=True)
    bag = export(result.recording, tmp_path / "ros2.mcap")
    urdf = bag.texts["/robot_description"]
    for t_ns, poses in bag.in_map():
        for link, pose in kinematics(urdf, bag.joints[t_ns]).items():
            assert agree(poses[link], pose, 1e-9), (t_ns, link)


@pytest.fixture(scope="module")
def sale(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sale")
    orders = ["duration=4s", "mission.params.orders=[juice]"]
    result = stepbus.run("store", set=orders, out=folder / "run", in_process=True)
    return result.recording, export(result.recording, folder / "ros2.mcap")


@pytest.mark.slow
def test_the_frames_of_a_mobile_robot_are_those_of_its_kinematics(sale):
    _, bag = sale
    urdf = bag.texts["/robot_description"]
    compared = 0
    for t_ns, poses in bag.in_map():
        if "shoulder_link" not in bag.tf[t_ns]:
            continue  # only the true poses were due
        for link, in_base in kinematics(urdf, bag.joints[t_ns]).items():
            if "wheel" not in link:
                assert agree(poses["chassis"].actInv(poses[link]), in_base, 1e-9), (t_ns, link)
                compared += 1
    assert compared > 1000
    assert bag.joints[0].keys() >= {"left_finger", "right_finger", "elbow_joint"}


@pytest.mark.slow
def test_map_odom_base_and_cameras_are_one_tree(sale):
    recording, bag = sale
    port = stepbus.Recording(recording)["plant.poses"]
    rows = {name: port.names.index(name) for name in ("chassis", "left_wheel_link", "floor")}
    true = {round(step * 16e6): message for step, message in port.messages()}
    times = [t_ns for t_ns in bag.tf if t_ns in true]
    assert len(times) > 50
    for t_ns, poses in bag.in_map():
        for name, row in rows.items() if t_ns in true and "chassis" in bag.tf[t_ns] else ():
            at = true[t_ns].position[row]
            assert np.allclose(poses[name].translation, at, atol=1e-6), (t_ns, name)
    assert bag.frames["/plant/odometry"] == ("odom", "chassis")
    assert bag.frames["/world/pose"] == ("map", "chassis")
    assert bag.frames["/plant/rgb"] == ("camera_optical_frame", "")
    assert bag.still["camera_optical_frame"][0] == "camera"
    known = bag.still | {name: row for placed in bag.tf.values() for name, row in placed.items()}
    assert known["odom"][0] == "map"
    assert known["chassis"][0] == "odom"
    assert not bag.still.keys() & {name for placed in bag.tf.values() for name in placed}
