"""The control laws, and the loop they close."""

import numpy as np
import pytest
from support.services.control import TWO_LINK, controller_config, make_controller

from stepbus_controller import Params
from stepbus_controller.laws import LAWS, Law, Reference, Robot
from stepbus_kinematics import RobotModel
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

DT = 0.005


def make_law(law: str, limit: float = 50.0, **params: object) -> Law:
    model = RobotModel(TWO_LINK / "two_link.urdf")
    robot = Robot(joints=model.joints, effort_limit=np.full(2, limit), model=model)
    return LAWS[law](
        robot, controller_config(law=law, model="two_link.urdf", **params).read(Params)
    )


def reference(position: float, acceleration: float = 0.0) -> Reference:
    return Reference(np.full(2, position), np.zeros(2), np.full(2, acceleration))


def test_pd_is_gain_times_error() -> None:
    law = make_law("pd", kp=[200, 100], kd={"joint2": 5, "joint1": 30})
    torque = law.torque(np.zeros(2), np.array([1.0, 1.0]), reference(0.1), DT)
    np.testing.assert_allclose(torque, [200 * 0.1 - 30, 100 * 0.1 - 5])


def test_pid_integrates_the_error_over_time() -> None:
    law = make_law("pid", kp=0, ki=100, kd=0)
    for _ in range(4):
        torque = law.torque(np.zeros(2), np.zeros(2), reference(0.1), DT)
    np.testing.assert_allclose(torque, 4 * 100 * 0.1 * DT)


@pytest.mark.parametrize(
    ("anti_windup", "recovers"), [("conditional_integration", True), ("none", False)]
)
def test_anti_windup_lets_a_saturated_pid_recover_at_once(anti_windup: str, recovers: bool) -> None:
    law = make_law("pid", limit=1.0, kp=1, ki=100, kd=0, anti_windup=anti_windup)
    for _ in range(200):
        law.torque(np.zeros(2), np.zeros(2), reference(5.0), DT)
    torque = law.torque(np.zeros(2), np.zeros(2), reference(-0.5), DT)
    assert (torque < 0).all() == recovers


def test_anti_windup_holds_only_the_joint_that_saturates() -> None:
    law = make_law("pid", limit=1.0, kp=0, ki=100, kd=0)
    target = Reference(np.array([5.0, 0.1]), np.zeros(2), np.zeros(2))
    for _ in range(10):
        torque = law.torque(np.zeros(2), np.zeros(2), target, DT)
    np.testing.assert_allclose(torque, [0.0, 10 * 100 * 0.1 * DT])


def test_pd_gravity_holds_the_arm_at_its_reference() -> None:
    law = make_law("pd_gravity", kp=200, kd=30)
    torque = law.torque(np.zeros(2), np.zeros(2), reference(0.0), DT)
    # Two bars of 1 kg and 1 m stretched out along x: m g (0.5 + 1.5) and m g 0.5, upwards.
    np.testing.assert_allclose(torque, [-2.0 * 9.81, -0.5 * 9.81])


def test_computed_torque_gives_the_wanted_acceleration() -> None:
    law = make_law("computed_torque", kp=100, kd=20)
    q, v = np.array([0.3, -0.4]), np.array([0.5, 0.7])
    torque = law.torque(q, v, reference(0.2, acceleration=2.0), DT)
    wanted = 2.0 + 100 * (0.2 - q) - 20 * v
    np.testing.assert_allclose(
        torque, RobotModel(TWO_LINK / "two_link.urdf").inverse_dynamics(q, v, wanted)
    )


def test_filtered_velocities_are_enough_to_track_within_a_milliradian(tmp_path) -> None:
    velocity = ["controller.params.velocity=filtered", "controller.params.cutoff_hz=50"]
    scenario = load("two_link/encoders", ["duration=4s", *velocity])
    result = run(scenario, Options(out=tmp_path / "out", host=InProcess()))
    error = Recording(result.recording)["controller.status"].error[400:]
    assert np.sqrt((error**2).mean(axis=0)).max() < 1e-3


def test_a_users_law_is_loaded_from_the_scenarios_folder(tmp_path) -> None:
    (tmp_path / "my_controller_law.py").write_text(
        "import numpy as np\n"
        "import stepbus\n"
        "class Constant:\n"
        "    class Params(stepbus.Settings):\n"
        "        torques: stepbus.params.PerJoint\n"
        "    def __init__(self, robot, params):\n"
        "        self.torques = np.array(params.torques.of(robot.joints))\n"
        "    def torque(self, q, v, reference, dt):\n"
        "        return self.torques\n"
    )
    config = controller_config(
        tmp_path,
        law="my_controller_law:Constant",
        joints=["joint1", "joint2"],
        effort_limit=50,
        torques={"joint2": 2, "joint1": 1},
    )
    controller = make_controller(config)
    assert controller.participant.law.torque(0, 0, 0, 0).tolist() == [1.0, 2.0]
