"""Models in SDF are read as the URDF that says the same."""

import numpy as np
import pytest

from stepbus_kinematics import RobotModel
from stepbus_participant import read_urdf_text
from stepbus_participant.urdf_check import Mimic, mimics, parse_urdf
from stepbus_plant.params import Params
from stepbus_plant.plant import SimulatedPlant
from stepbus_plant.world_file import load_world
from stepbus_schemas import WiringError

INERTIAL = """<inertial><pose>0.2 0 0 0 0 0</pose><mass>1.5</mass><inertia><ixx>0.01</ixx>
<iyy>0.02</iyy><izz>0.02</izz></inertia></inertial>"""
LIMIT = "<limit><lower>-2</lower><upper>2</upper><effort>50</effort></limit>"
SDF = f"""<sdf version="1.7"><model name="arm">
<link name="base">{INERTIAL}</link>
<link name="upper"><pose>0 0 0.3 0 0.5 0</pose>{INERTIAL}
<collision name="c"><geometry><box><size>0.4 0.1 0.1</size></box></geometry></collision></link>
<link name="tool"><pose relative_to="upper">0.4 0 0 0.2 0 0</pose>{INERTIAL}</link>
<joint name="shoulder" type="revolute"><parent>base</parent><child>upper</child>
<axis><xyz>0 1 0</xyz>{LIMIT}</axis></joint>
<joint name="slide" type="prismatic"><pose>0.1 0 0 0 0 0.3</pose><parent>upper</parent>
<child>tool</child><axis><xyz>1 0 0</xyz>{LIMIT}</axis></joint></model></sdf>"""


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.sdf"
    path.write_text(SDF)
    return path


def test_links_are_where_the_sdf_places_them(arm):
    robot = RobotModel(arm)
    assert robot.joints == ("shoulder", "slide")
    here = robot.frame_pose(np.zeros(2), "tool")
    # The frame of the link is that of its joint: 0.4 m + 0.1 m along the upper link.
    along = np.array([np.cos(0.5), 0.0, -np.sin(0.5)])
    side = np.array([0.0, 1.0, 0.0])
    assert here.translation == pytest.approx(np.array([0.0, 0.0, 0.3]) + 0.5 * along)
    moved = robot.frame_pose(np.array([0.0, 1.0]), "tool").translation - here.translation
    turned = np.cos(0.2) * side + np.sin(0.2) * np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    assert moved == pytest.approx(np.cos(0.3) * along + np.sin(0.3) * turned)


def test_masses_stay_where_they_are(arm):
    robot = RobotModel(arm)
    q, g = np.zeros(2), 9.81
    # Both centres of mass ahead of the shoulder, at a slope of 0.5 rad.
    assert robot.gravity_torque(q)[0] == pytest.approx(-1.5 * g * np.cos(0.5) * (0.2 + 0.6))


def test_plant_and_controller_read_the_same_dynamics(arm, tmp_path):
    world = tmp_path / "world.yaml"
    world.write_text("physics_step: 1ms\nbodies: {arm: {urdf: arm.sdf, fixed_base: true}}")
    plant = SimulatedPlant(load_world(world), Params(world=world), 1_000_000, 0)
    robot, start = RobotModel(arm), np.array(plant.sense().position)
    plant.advance()
    acceleration = np.array(plant.sense().velocity) / 1e-3
    torque = robot.inverse_dynamics(start, np.zeros(2), acceleration)
    assert torque == pytest.approx([0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"prismatic"', '"ball"', "11: joint 'slide' is ball, which is not"),
        ('relative_to="upper"', 'relative_to="uper"', "7: its pose is relative to 'uper'"),
        ("</model>", "</model><model/>", "1: has 2 models; use a file with one"),
        ("</model>", "<include/></model>", "12: <include> in a model is not"),
        ("<xyz>1 0 0</xyz>", "<xyz>1 0</xyz>", "12: <xyz> '1 0' is not 3 numbers"),
        ('version="1.7"', 'version=""', "1: its version is '', not a version"),
        ('version="1.7"', 'version="1.x"', "1: its version is '1.x', not a version"),
        ('name="tool"', 'name="upper"', "7: link 'upper' is defined twice, first"),
        (
            'name="slide"',
            'name="shoulder"',
            "11: joint 'shoulder' is defined twice,",
        ),
    ],
)
def test_a_mistake_is_refused_with_its_line(tmp_path, old, new, message):
    path = tmp_path / "arm.sdf"
    path.write_text(SDF.replace(old, new, 1))
    with pytest.raises(WiringError, match=message):
        read_urdf_text(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<inertial>", '<inertial auto="true">', '<inertial auto="true"> is not supported'),
        ('<model name="arm">', '<model name="arm"><static>true</static>', "<static> true .*fixed_base"),
        ('<link name="base">', '<link name="base"><gravity>false</gravity>', "<gravity> false"),
        ("</axis>", "<dynamics><spring_stiffness>3</spring_stiffness></dynamics></axis>", "<spring_stiffness> 3"),
    ],
)  # fmt: skip
def test_what_changes_the_motion_and_no_urdf_says_is_refused(tmp_path, old, new, message):
    (tmp_path / "arm.sdf").write_text(SDF.replace(old, new, 1))
    with pytest.raises(WiringError, match=rf"arm\.sdf:\d+: {message}"):
        read_urdf_text(tmp_path / "arm.sdf")


def test_a_colour_of_three_numbers_is_opaque(tmp_path):
    visual = '<visual name="v"><geometry><sphere><radius>1</radius></sphere></geometry>'
    painted = f"{visual}<material><diffuse>0.2 0.4 0.6</diffuse></material></visual></link>"
    (tmp_path / "arm.sdf").write_text(SDF.replace("</link>", painted, 1))
    assert 'rgba="0.2 0.4 0.6 1.0"' in read_urdf_text(tmp_path / "arm.sdf")


def test_a_joint_follows_another_one_as_in_a_urdf(tmp_path):
    path = tmp_path / "arm.sdf"
    followed = '<mimic joint="shoulder"><multiplier>0.5</multiplier><reference>0.2</reference>'
    text = SDF.replace("<xyz>1 0 0</xyz>", f"<xyz>1 0 0</xyz>{followed}<offset>1</offset></mimic>")
    path.write_text(text)
    assert mimics(parse_urdf(read_urdf_text(path))) == {
        "slide": Mimic(joint="shoulder", multiplier=0.5, offset=0.9)
    }
    path.write_text(text.replace('joint="shoulder"', 'joint="elbow"'))
    with pytest.raises(WiringError, match="follows joint 'elbow'"):
        read_urdf_text(path)
