"""Rigid-body dynamics with joints by name."""

import numpy as np
import pytest
from support.services.control import TWO_LINK, controller_config

from stepbus_controller.controller import Controller
from stepbus_kinematics import RobotModel
from stepbus_schemas import WiringError

URDF = TWO_LINK / "two_link.urdf"
Q, V, A = np.array([0.3, -0.8]), np.array([0.5, 0.7]), np.array([-1.0, 2.0])


def test_the_joint_order_permutes_the_torques_and_nothing_else() -> None:
    forward = RobotModel(URDF).inverse_dynamics(Q, V, A)
    backward = RobotModel(URDF, ["joint2", "joint1"]).inverse_dynamics(Q[::-1], V[::-1], A[::-1])
    assert forward.tolist() == backward[::-1].tolist()


def test_inverse_dynamics_at_rest_is_gravity() -> None:
    robot = RobotModel(URDF)
    np.testing.assert_allclose(robot.inverse_dynamics(Q, 0 * V, 0 * A), robot.gravity_torque(Q))


def test_what_is_carried_counts_in_all_torques_until_it_is_put_down() -> None:
    robot = RobotModel(URDF)
    empty, moving = robot.gravity_torque(Q), robot.inverse_dynamics(Q, V, A)
    _, jacobian = robot.jacobian(Q, robot.frame_id("link2"))
    assert abs(jacobian[2, 0]) > 0.1
    robot.carry(0.5, "link2")
    np.testing.assert_allclose(robot.gravity_torque(Q), empty + jacobian[2] * 0.5 * 9.81)
    assert abs(robot.inverse_dynamics(Q, V, A)[0] - moving[0]) > 0.1
    robot.carry(1.0, "link2")
    np.testing.assert_allclose(robot.gravity_torque(Q), empty + jacobian[2] * 1.0 * 9.81)
    robot.carry(0.0, "link2")
    assert robot.gravity_torque(Q).tolist() == empty.tolist()


def test_joints_that_are_not_controlled_are_held_at_zero() -> None:
    alone = RobotModel(URDF, ["joint1"]).gravity_torque(np.array([0.3]))
    assert alone[0] == pytest.approx(RobotModel(URDF).gravity_torque(np.array([0.3, 0.0]))[0])


def test_a_planar_joint_is_refused(tmp_path) -> None:
    path = tmp_path / "planar.urdf"
    path.write_text(URDF.read_text().replace('"joint1" type="revolute"', '"joint1" type="planar"'))
    with pytest.raises(WiringError, match=r"'joint1' is 'planar', which is not supported"):
        RobotModel(path)


def test_an_effort_limit_the_model_leaves_at_zero_has_to_be_given(tmp_path) -> None:
    (tmp_path / "weak.urdf").write_text(URDF.read_text().replace('effort="50"', 'effort="0"'))
    config = controller_config(tmp_path, law="pd", kp=1, kd=1, model="weak.urdf")
    with pytest.raises(WiringError, match="0 N·m for joint 'joint2' in the model"):
        Controller(config)
