"""Inverse kinematics: what is reached is reached, and what is not says why, with numbers."""

import numpy as np
import pinocchio as pin
import pytest
from support.services.arm import JOINTS, make_ik, write_arm

from stepbus_kinematics import RobotModel
from stepbus_schemas import RunError

BENT = np.array([0.3, 0.4, 0.5])


@pytest.fixture
def robot(tmp_path):
    return RobotModel(write_arm(tmp_path), JOINTS)


def test_every_reachable_pose_is_reached_within_the_limits(robot):
    random, ik = np.random.default_rng(3), make_ik(robot)
    for _ in range(30):
        target = robot.frame_pose(random.uniform(-2.4, 2.4, 3), "hand")
        found = ik.solve("hand", target, BENT)
        off = robot.frame_pose(found.q, "hand").actInv(target)
        assert found.verdict in {"reached", "singular"}
        assert np.linalg.norm(off.translation) < 2e-5
        assert (np.abs(found.q) <= 2.5).all()


def test_an_unreachable_pose_tells_how_close_it_gets(robot):
    found = make_ik(robot).solve("hand", pin.SE3(np.eye(3), np.array([4.0, 0, 0])), BENT)
    assert found.verdict == "unreachable"
    assert found.position_error == pytest.approx(1.0, abs=1e-3)
    assert "1000.0 mm and 0.0°" in str(found)


def test_a_singular_pose_tells_its_smallest_singular_value(robot):
    found = make_ik(robot).solve("hand", robot.frame_pose(np.zeros(3), "hand"), BENT)
    assert found.verdict == "singular"
    assert found.smallest_singular_value < 0.01


def test_a_pose_the_motors_cannot_hold_tells_joint_and_torques(tmp_path):
    robot = RobotModel(write_arm(tmp_path, effort=30.0), JOINTS)
    q = np.array([-0.1, 0.1, 0.1])
    found = make_ik(robot).judge(q, np.arange(3))
    arms = 0.5 * np.cos(-0.1) * 5 + 0.5 * np.cos(0.0) * 3 + 0.5 * np.cos(0.1)
    assert found.verdict == "not_holdable"
    assert found.overload.joint == "one"
    assert found.overload.required == pytest.approx(9.81 * arms)
    assert str(found) == f"not holdable: one needs {9.81 * arms:.1f} N·m and has 30.0 N·m"


def test_the_order_of_the_joints_is_the_callers(tmp_path, robot):
    turned = RobotModel(robot.path, JOINTS[::-1])
    q = np.array([0.1, 0.7, -0.4])
    assert turned.frame_pose(q[::-1], "hand").isApprox(robot.frame_pose(q, "hand"))
    assert turned.overload(q[::-1]) == robot.overload(q)
    assert list(turned.chain("link_1")) == [1, 2]


def test_an_unknown_frame_is_named_with_the_nearest(robot):
    with pytest.raises(RunError, match=r"frame 'hnad' is not in arm\.urdf"):
        make_ik(robot).solve("hnad", pin.SE3.Identity(), BENT)
