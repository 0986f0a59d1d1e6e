"""Joints with <mimic> follow another one, in the engine and in the model of a controller."""

import numpy as np
import pytest

from stepbus_kinematics import RobotModel
from stepbus_models import read_robot
from stepbus_plant.params import Params
from stepbus_plant.plant import SimulatedPlant
from stepbus_plant.world_file import load_world
from stepbus_schemas import JointCommand, WiringError

LINK = """<link name="{name}"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
LIMIT = '<limit lower="-3" upper="3" effort="50" velocity="5"/>'
ARM = f"""<robot name="r">{"".join(LINK.format(name=name) for name in ("base", "a", "b"))}
<joint name="lead" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
{LIMIT}</joint>
<joint name="follow" type="TYPE"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/>{LIMIT}<mimic joint="lead" multiplier="-0.5" offset="0.3"/></joint></robot>"""
JOINTS = "lead: {position: 0.4}"


def make(tmp_path, joint_type="revolute", joints=JOINTS):
    (tmp_path / "arm.urdf").write_text(ARM.replace("TYPE", joint_type))
    (tmp_path / "world.yaml").write_text(
        "physics_step: 1ms\nbodies: {arm: {urdf: arm.urdf, fixed_base: true, joints: {"
        + joints + "}}}"
    )  # fmt: skip
    params = Params(world=tmp_path / "world.yaml")
    return SimulatedPlant(load_world(params.world), params, 5_000_000, 0)


def followed(position):
    return -0.5 * position + 0.3


def test_a_follower_starts_where_its_joint_takes_it_and_has_no_motor(tmp_path):
    plant = make(tmp_path)
    assert plant.sense().position == pytest.approx([0.4, 0.1])
    assert plant.joints.description.details["mode"] == ["torque", "passive"]
    assert plant.joints.description.details["mimic"] == ["", "lead"]


@pytest.mark.parametrize("joint_type", ["revolute", "continuous", "prismatic"])
def test_computed_torque_moves_joint_and_follower_as_one(tmp_path, joint_type):
    plant, robot = make(tmp_path, joint_type), RobotModel(tmp_path / "arm.urdf")
    commander = plant.commander("command", robot.joints)
    assert robot.joints == ("lead",)
    for t in np.arange(400) * 0.005:
        state = plant.sense()
        q, v = np.array(state.position[:1]), np.array(state.velocity[:1])
        wanted, rate, a = 0.9 - 0.5 * np.cos(2 * t), np.sin(2 * t), 2 * np.cos(2 * t)
        torque = robot.inverse_dynamics(q, v, a + 100 * (wanted - q) + 20 * (rate - v))
        assert abs(wanted - q[0]) < 2e-3
        assert state.position[1] == pytest.approx(followed(q[0]), abs=1e-4)
        commander.apply(JointCommand(mode="torque", values=torque.tolist()))
        plant.advance()


def test_stops_of_a_follower_do_not_hold_the_joint_that_it_follows(tmp_path):
    """Its joint takes it to −0.2 rad; its own stops end at 0.25 rad."""
    make(tmp_path)
    path = tmp_path / "arm.urdf"
    narrow = LIMIT.replace('lower="-3"', 'lower="0.25"')
    path.write_text(narrow.join(path.read_text().rsplit(LIMIT, 1)))
    joints = "{joint_defaults: {mode: velocity}, urdf: arm.urdf, fixed_base: true}"
    (tmp_path / "world.yaml").write_text(f"physics_step: 1ms\nbodies: {{arm: {joints}}}")
    params = Params(world=tmp_path / "world.yaml")
    plant = SimulatedPlant(load_world(params.world), params, 5_000_000, 0)
    assert plant.joints.description.limits["lower"] == [-3.0, 0.25]
    plant.commander("command", ["lead"]).apply(JointCommand(mode="velocity", values=[1.0]))
    for _ in range(200):
        plant.advance()
    assert plant.sense().position == pytest.approx([1.0, followed(1.0)], abs=5e-3)


def test_a_teleport_takes_the_follower_along(tmp_path):
    plant = make(tmp_path)
    plant.calls.teleport("lead", 1.0)
    assert plant.sense().position == pytest.approx([1.0, followed(1.0)])


def test_a_command_to_a_follower_is_a_warning_that_names_its_joint(tmp_path):
    plant = make(tmp_path)
    commander = plant.commander("command", ["lead", "follow"])
    commander.apply(JointCommand(mode="torque", values=[0.0, 1.0]))
    (warning,) = plant.warnings.pending
    assert warning.startswith("joint follow: follows joint 'lead'")


def test_a_follower_moves_on_its_own_where_the_world_says_so(tmp_path):
    plant = make(tmp_path, joints="follow: {mimic: false, position: 0.7}")
    assert plant.sense().position == [0.0, 0.7]


def test_settings_that_a_follower_cannot_have_are_refused(tmp_path):
    with pytest.raises(WiringError, match="follows joint 'lead'"):
        make(tmp_path, joints="follow: {position: 0.7}")


def test_a_controller_of_a_follower_is_refused_with_the_joint_to_name(tmp_path):
    make(tmp_path)
    with pytest.raises(
        WiringError,
        match=r"'follow' of arm\.urdf follows 'lead'",
    ):
        RobotModel(tmp_path / "arm.urdf", ["follow"])


def test_a_follower_of_a_joint_that_stands_still_stands_where_that_takes_it(tmp_path):
    text = ARM.replace("TYPE", "revolute").replace("</robot>", "") + LINK.format(name="c")
    more = '<joint name="own" type="revolute"><parent link="b"/><child link="c"/>'
    path = tmp_path / "arm.urdf"
    path.write_text(f"{text}{more}{LIMIT}</joint></robot>")
    assert len(read_robot(path).joints) == 3
    robot = RobotModel(path, ["own"], posture={"lead": 0.4})
    assert robot.stance == pytest.approx([0.4, followed(0.4), 0.0])


def test_a_body_that_can_only_fall_is_a_warning(tmp_path):
    plant = make(tmp_path)
    assert plant.physics.notes == []
    path = tmp_path / "world.yaml"
    path.write_text(path.read_text().replace("fixed_base: true, ", ""))
    params = Params(world=path)
    ((body, warning),) = SimulatedPlant(load_world(path), params, 5_000_000, 0).physics.notes
    assert body == "body arm"
    assert warning.startswith("it is not fixed to the world")
    assert warning.endswith("add `fixed_base: true`?")
