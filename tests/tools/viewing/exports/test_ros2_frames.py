"""The frames of an export for ROS 2, against forward kinematics and the true poses of the plant."""

from importlib.resources import files

import numpy as np
import pytest
from support.runs.ros2 import agree, export, kinematics

import stepbus

TWO_ARMS = """
name: two_arms
step: 5ms
duration: 500ms
participants:
  plant:
    participant: stepbus_plant:Plant
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
