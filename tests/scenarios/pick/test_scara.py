"""The kinematics of a SCARA arm, and the models that are none."""

import math
import random
from pathlib import Path

import numpy as np
import pytest

import stepbus_scenarios
from stepbus_kinematics import RobotModel
from stepbus_scenarios.pick.scara import Scara, Spot
from stepbus_schemas import WiringError

MODEL = Path(stepbus_scenarios.__file__).parent / "pick/scara.urdf"
JOINTS = ["shoulder", "elbow", "lift", "wrist"]
ARM = Scara.read(MODEL, JOINTS, "base", "grasp")


def forward(q):
    """Return the spot of the tip, by Pinocchio."""
    pose = RobotModel(MODEL, JOINTS).frame_pose(np.array(q), "grasp")
    x, y, z = pose.translation
    return Spot(x=x, y=y, z=z, yaw=math.atan2(pose.rotation[1, 0], pose.rotation[0, 0]))


def refusal(folder, old, new):
    """Return why an arm is refused in whose model some text is another one."""
    text = MODEL.read_text()
    assert old in text
    (folder / "arm.urdf").write_text(text.replace(old, new, 1))
    with pytest.raises(WiringError) as caught:
        Scara.read(folder / "arm.urdf", JOINTS, "base", "grasp")
    return str(caught.value)


def test_the_lengths_are_those_of_the_model():
    assert (ARM.near, ARM.far) == (0.3, 0.25)
    assert ARM.height == pytest.approx(0.18)


def test_inverse_kinematics_leads_to_where_forward_kinematics_says():
    numbers = random.Random(7)
    for _ in range(30):
        q = [numbers.uniform(a, b) for a, b in zip(ARM.lower, ARM.upper, strict=True)]
        tool = forward(q)
        again = forward(ARM.inverse(tool))
        assert math.dist((tool.x, tool.y, tool.z), (again.x, again.y, again.z)) < 1e-9
        assert abs(math.remainder(tool.yaw - again.yaw, math.pi / 2)) < 1e-9


def test_the_elbow_goes_to_its_other_side_where_only_that_is_within_the_limits():
    tool = forward([-2.4, -1.0, -0.1, 0.0])
    assert ARM.inverse(tool) == pytest.approx([-2.4, -1.0, -0.1, 0.0])


def test_the_wrist_turns_to_the_nearest_side_of_the_cube():
    tool = Spot(x=0.3, y=0.2, z=0.1, yaw=0.4)
    assert abs(ARM.inverse(tool, near=2.0)[3] - 2.0) <= math.pi / 4


@pytest.mark.parametrize(("x", "z"), [(0.56, 0.1), (0.04, 0.1), (0.3, 0.19), (0.3, -0.01)])
def test_what_is_out_of_reach_has_no_positions(x, z):
    assert ARM.inverse(Spot(x=x, y=0.0, z=z, yaw=0.0)) is None


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (
            'name="lift" type="prismatic"',
            'name="lift" type="revolute"',
            "'lift' must be prismatic with the axis 0 0 1",
        ),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>', "'shoulder' must be revolute or continuous"),
        ('<origin xyz="0.3 0 0.05"/>', '<origin xyz="0.3 0.1 0.05"/>', "not aligned along x"),
        (
            '<origin xyz="0.3 0 0.05"/>',
            '<origin xyz="0.3 0 0.05" rpy="1 0 0"/>',
            "joint 'elbow' is rotated",
        ),
    ],
)
def test_a_model_that_is_no_scara_arm_is_refused_with_a_reason(tmp_path, old, new, reason):
    assert reason in refusal(tmp_path, old, new)


@pytest.mark.parametrize(
    ("base", "tip", "reason"),
    [
        ("base", "gras", "link 'gras' is unknown; did you mean 'grasp'"),
        ("forearm", "upper_arm", "no chain of joints connects link 'forearm' to 'upper_arm'"),
        ("left_pad", "grasp", "no chain of joints connects link 'left_pad' to 'grasp'"),
        ("base", "hand", None),
        ("upper_arm", "grasp", "are elbow, lift, wrist, not"),
    ],
)
def test_base_and_tip_are_links_with_the_four_joints_between_them(base, tip, reason):
    if reason is None:
        assert Scara.read(MODEL, JOINTS, base, tip).height == pytest.approx(0.25)
        return
    with pytest.raises(WiringError, match=reason):
        Scara.read(MODEL, JOINTS, base, tip)


def test_joints_in_another_order_are_refused():
    with pytest.raises(WiringError, match="are shoulder, elbow, lift, wrist, not"):
        Scara.read(MODEL, [*JOINTS[1:], JOINTS[0]], "base", "grasp")
