"""The frames of a sale, exported for ROS 2: of a mobile robot, its cameras and its estimated pose."""

import numpy as np
import pytest
from support.runs.ros2 import agree, export, kinematics

import stepbus

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sale(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sale")
    orders = ["duration=4s", "mission.params.orders=[juice]"]
    result = stepbus.run("store", set=orders, out=folder / "run", in_process=True)
    return result.recording, export(result.recording, folder / "ros2.mcap")


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
    assert bag.frames["/plant/rgb/image_raw"] == ("camera_optical_frame", "")
    assert bag.still["camera_optical_frame"][0] == "camera"
    known = bag.still | {name: row for placed in bag.tf.values() for name, row in placed.items()}
    assert known["odom"][0] == "map"
    assert known["chassis"][0] == "odom"
    assert not bag.still.keys() & {name for placed in bag.tf.values() for name in placed}
