"""MJCF as MuJoCo compiles it: compared with MuJoCo itself."""

import os
import struct
import sys

import numpy as np
import pytest
from support.mjcf import FINGER, SLIDE, part, robot_of, save

from stepbus_kinematics import RobotModel
from stepbus_models import Mimic, read_robot
from stepbus_participant import ExtraMissing
from stepbus_schemas import WiringError
from stepbus_tools.viewing.scene.model import load_model

mujoco = pytest.importorskip("mujoco", reason="the package mujoco is not installed")

ARM = """<mujoco model="arm"><compiler angle="degree" eulerseq="ZYX"/>
<default><joint axis="0 1 0" range="-170 170"/><geom type="capsule" size=".03" density="800"/>
<default class="seen"><geom contype="0" conaffinity="0" group="2" rgba="1 0 0 1"/></default>
</default>
<worldbody><body name="base" pos=".3 0 1" euler="20 0 40"><freejoint/><geom type="box" size=".1 .1 .1"/>
<body name="upper" pos="0 .1 .1" euler="10 90 -30"><joint name="shoulder" ref="15"/>
<geom fromto="0 0 0 .1 .2 .4"/><geom class="seen" type="sphere" pos="0 0 .1"/>
<body name="lower" pos=".1 .2 .4" axisangle="1 2 3 35"><joint name="elbow" pos=".02 .01 -.05"/>
<geom fromto="0 0 0 .3 0 .1"/><geom type="box" size=".02 .03 .05" pos=".3 0 .1" euler="5 6 7"/>
<body name="tip" pos=".3 0 .1"><site name="tcp"/></body></body></body></body></worldbody></mujoco>"""

CART = """<mujoco model="cart"><default><geom size=".05" mass="1"/></default>
<worldbody><body name="base"><geom type="box" size=".2 .2 .1" mass="5"/>
<body name="carriage" pos="0 0 .4" quat=".9 .1 .2 .3">
<joint name="rail" type="slide" axis="1 0 .5" ref=".1" range="-1 1"/>
<joint name="swing" axis="0 1 0" pos="0 0 .1"/><joint name="roll" axis="1 0 0"/>
<geom pos="0 .05 -.3"/><geom type="cylinder" size=".02 .1" pos="0 0 -.1" mass=".3"/>
<body name="bob" pos="0 0 -.3"><joint name="spin" axis="0 1 1"/><geom pos=".1 0 -.2"/></body>
</body></body></worldbody></mujoco>"""

POLE = """<mujoco model="pole"><worldbody><body name="cart" pos="0 0 1" euler="0 0 90">
<joint name="slide" type="slide" axis="1 0 0" ref=".3"/><geom type="box" size=".2 .1 .1" mass="2"/>
<body name="pole"><joint name="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .1 0 .5"
size=".02" mass=".4"/></body></body></worldbody></mujoco>"""

MODELS = {"arm": ARM, "cart": CART, "pole": POLE}


def standing(text):
    """Return a MuJoCo model of a text whose root stands, as the plant steps it."""
    model = mujoco.MjSpec.from_string(text.replace("<freejoint/>", "")).compile()
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("name", MODELS)
def test_links_are_where_mujoco_has_their_bodies(tmp_path, name):
    robot = RobotModel(save(tmp_path, MODELS[name]))
    model, data = standing(MODELS[name])
    assert sorted(robot.joints) == sorted(model.joint(n).name for n in range(model.njnt))
    # A root that moves in the world is below a link for that.
    top = 0 if name == "pole" else 1
    random = np.random.default_rng(7)
    for q in random.uniform(-1.0, 1.0, (20, len(robot.joints))):
        for joint, value in zip(robot.joints, q, strict=True):
            data.qpos[model.joint(joint).qposadr] = value
        mujoco.mj_kinematics(model, data)
        base = data.xmat[top].reshape(3, 3)
        for body in range(top, model.nbody):
            pose = robot.frame_pose(q, model.body(body).name)
            place = base.T @ (data.xpos[body] - data.xpos[top])
            assert pose.translation == pytest.approx(place, abs=1e-9)
            turn = base.T @ data.xmat[body].reshape(3, 3)
            assert pose.rotation == pytest.approx(turn, abs=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_a_controller_computes_the_torques_of_mujoco(tmp_path, name):
    model, data = standing(MODELS[name])
    top = 0 if name == "pole" else 1
    mujoco.mj_kinematics(model, data)
    gravity = data.xmat[top].reshape(3, 3).T @ model.opt.gravity
    robot = RobotModel(save(tmp_path, MODELS[name]), gravity=gravity)
    rows = np.array([model.joint(joint).qposadr[0] for joint in robot.joints])
    q, v, a = np.random.default_rng(7).uniform(-1.0, 1.0, (3, len(rows)))
    data.qpos[rows], data.qvel[rows], data.qacc[rows] = q, v, a
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    torque = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 1, torque)
    assert robot.inverse_dynamics(q, v, a) == pytest.approx(torque[rows], abs=1e-9)
    inertials = [link.inertial for link in robot.robot.links.values() if link.inertial]
    assert sum(row.mass for row in inertials) == pytest.approx(sum(model.body_mass), abs=1e-12)


def stl(vertices, triangles):
    """Return a binary STL."""
    rows = [struct.pack("<12fH", 0, 0, 0, *vertices[list(t)].ravel(), 0) for t in triangles]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def test_meshes_are_those_of_the_files_where_mujoco_has_them(tmp_path, monkeypatch):
    corners = np.random.default_rng(5).uniform(-1, 1, (4, 3)).astype(np.float32)
    sides = [(0, 1, 2), (0, 3, 1), (1, 3, 2), (0, 2, 3)]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/wedge.stl").write_bytes(stl(corners, sides))
    text = part(
        before='<compiler meshdir="../parts"/>'
        '<asset><mesh name="wedge" file="wedge.stl" scale=".1 .2 -.3"/></asset>',
        body='<geom name="w" type="mesh" mesh="wedge" pos="1 2 3" euler="10 20 30" mass="1"/>',
    )
    path = save(tmp_path, text, "model/arm.xml")
    monkeypatch.chdir(tmp_path)
    robot = read_robot(path.relative_to(tmp_path))
    (mesh,) = (shape for shape in robot.links["arm"].collisions if shape.kind == "mesh")
    assert (tmp_path / "parts/wedge.stl").samefile(mesh.mesh)
    (seen,) = [v for v in load_model(path).links["arm"] if len(v.mesh.vertices) <= 12]
    rows = np.array(seen.mesh.vertices)
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, np.array(seen.pose.wxyz))
    here = rows @ turned.reshape(3, 3).T + seen.pose.position
    model = mujoco.MjModel.from_xml_path(str(path))
    geom = model.geom("w").id
    mujoco.mju_quat2Mat(turned, model.geom_quat[geom])
    there = model.mesh_vert @ turned.reshape(3, 3).T + model.geom_pos[geom]
    assert len(there) == 4
    for corner in there:
        assert np.linalg.norm(here - corner, axis=1).min() < 1e-6


@pytest.mark.parametrize(
    ("actuators", "joint", "effort"),
    [
        ("", "", 1e12),
        ('<motor joint="hinge" ctrlrange="-3 5" gear="10"/>', "", 50.0),
        ('<position joint="hinge" kp="9" ctrlrange="-1 1" forcerange="-7 6"/>', "", 7.0),
        ('<position joint="hinge" kp="9" ctrlrange="-1 1"/>', "", 1e12),
        ('<motor joint="hinge" ctrlrange="-1 1"/><motor joint="hinge" ctrlrange="0 2"/>', "", 3.0),
        ('<motor joint="hinge" ctrlrange="-9 9"/>', 'actuatorfrcrange="-4 4"', 4.0),
    ],
)
def test_the_effort_of_a_joint_is_that_of_its_actuators(tmp_path, actuators, joint, effort):
    robot = robot_of(tmp_path, part(f"<actuator>{actuators}</actuator>", joint=joint))
    assert robot.joints["hinge"].effort == effort


def test_limits_damping_friction_and_colours_are_taken(tmp_path):
    text = part(
        joint='range="-90 45" damping=".2" frictionloss=".3"',
        before='<asset><material name="red" rgba="1 0 0 1"/></asset>',
        solid='material="red"',
    )
    robot = robot_of(tmp_path, text)
    joint = robot.joints["hinge"]
    assert (joint.type, joint.damping, joint.friction) == ("revolute", 0.2, 0.3)
    assert (joint.lower, joint.upper) == pytest.approx((-np.pi / 2, np.pi / 4))
    assert robot.links["arm"].visuals[0].rgba == (1.0, 0.0, 0.0, 1.0)


def test_a_slide_without_a_range_has_no_stops(tmp_path):
    path = save(tmp_path, part(body=FINGER.replace('range="0 1"', "")))
    assert RobotModel(path, ["slide", "hinge"]).upper.tolist() == [np.inf, np.inf]
    with pytest.raises(WiringError, match=r"of arm\.xml has no position limits"):
        RobotModel(path, ["slide"], bounded=True)


def test_shapes_are_as_large_as_in_mujoco(tmp_path):
    shapes = ('box" size=".1 .2 .3', 'cylinder" size=".1 .2', 'capsule" size=".1 .2')
    robot = robot_of(tmp_path, part(body="".join(f'<geom type="{shape}"/>' for shape in shapes)))
    assert [(shape.kind, shape.size) for shape in robot.links["arm"].collisions[1:]] == [
        ("box", (0.2, 0.4, 0.6)),
        ("cylinder", (0.1, 0.4)),
        ("capsule", (0.1, 0.4)),
    ]


def test_joints_follow_others_as_mujoco_couples_them(tmp_path):
    body = SLIDE.format(
        '<geom size=".1"/><body><joint name="far" ref="20"/><geom size=".1"/></body>'
    )
    rows = (
        '<joint joint1="far" joint2="slide" polycoef=".5 3 0 0 0"/>'
        '<joint joint1="slide" joint2="hinge" polycoef=".1 2 0 0 0"/>'
    )
    text = part(f"<equality>{rows}</equality>", body=body, joint='ref="30"')
    joints = robot_of(tmp_path, text).joints
    thirty, twenty = np.radians([30, 20])
    slide = Mimic(joint="hinge", multiplier=2.0, offset=0.1 - 2 * thirty)
    assert joints["slide"].mimic == slide
    far = joints["far"].mimic
    assert (far.joint, far.multiplier) == ("hinge", 6.0)
    assert far.offset == pytest.approx(0.5 + twenty + 3 * slide.offset)
    circle = rows.replace('joint2="hinge"', 'joint2="far"')
    with pytest.raises(WiringError, match="follows itself through its couplings"):
        robot_of(tmp_path, text.replace(rows, circle))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><bod/></mujoco>", "MuJoCo cannot compile it: .*unrecognized element .*line 1"),
        ('<mujoco><include file="no.xml"/></mujoco>', "MuJoCo cannot compile it: .*'no.xml'"),
        ('<mujoco><asset><mesh file="no.stl"/></asset></mujoco>', "Error opening file .*no.stl"),
        ('<mujoco><include file="pipe"/></mujoco>', "'pipe' is not a regular file"),
        (
            '<mujoco><compiler meshdir="parts"/><asset><mesh file="../pipe"/></asset></mujoco>',
            "'../pipe' is not a regular file",
        ),
        ('<mujoco><include file="more.xml"/></mujoco>', "more.xml: '/dev/zero' is not a regular"),
        (part(body="<body><joint/></body>"), "mass and inertia of moving"),
        (part(body='<body pos="nan 0 0"/>'), "the position of a body is not finite"),
        ("<mujoco>", "arm.xml:1: is not XML"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*NaN")
def test_a_mistake_is_one_error(tmp_path, text, message):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "parts").mkdir()
    save(tmp_path, '<mujoco><include file="/dev/zero"/></mujoco>', "more.xml")
    with pytest.raises(WiringError, match=message):
        robot_of(tmp_path, text)


SPRING = '<tendon><fixed name="t"><joint joint="hinge" coef="1"/></fixed></tendon>'
BALL = '<body><joint name="b" type="ball"/><geom size=".1"/></body>'


@pytest.mark.parametrize(
    ("text", "left_out"),
    [
        (part(body=BALL), "ball joints (1)"),
        (part(joint='stiffness="5 1"'), "nonlinear springs and dampers of joints (1)"),
        (part(joint='damping="5 1"'), "nonlinear springs and dampers of joints (1)"),
        (part(SPRING), "tendons (1)"),
        (part('<equality><weld name="w" body1="arm"/></equality>'), "constraints (1)"),
        (part(body='<geom type="ellipsoid" size=".1 .2 .3"/>'), "shapes (1)"),
        (part().replace("<worldbody>", '<worldbody><geom name="g" size="1"/>'), "geoms of the world (1)"),
    ],
)  # fmt: skip
def test_what_a_description_has_no_words_for_is_counted(tmp_path, text, left_out):
    path = save(tmp_path, text)
    lead = "controllers, views and exports leave out some of this MJCF: "
    assert read_robot(path).warnings == (lead + left_out,)
    assert load_model(path).notes == (lead + left_out,)


def test_a_controller_refuses_a_ball_joint_by_name(tmp_path):
    with pytest.raises(WiringError, match=r"joint 'b' of arm\.xml is a ball joint"):
        RobotModel(save(tmp_path, part(body=BALL)), ["hinge"])


def test_what_changes_nothing_is_left_out_silently(tmp_path):
    extra = '<equality><weld body1="arm" active="false"/></equality>'
    extra += '<keyframe><key qpos="1"/></keyframe><sensor><jointpos joint="hinge"/></sensor>'
    seen = '<site/><camera/><light/><geom type="sphere" size="9" contype="0" conaffinity="0" group="4"/>'
    robot = robot_of(tmp_path, part(extra, body=seen))
    assert robot.warnings == ()
    assert len(robot.links["arm"].visuals) == 1


def test_several_bodies_are_below_the_world(tmp_path):
    ball = '<body name="{0}"><joint name="j{0}"/><geom size=".1"/></body>'
    text = f"<mujoco><worldbody>{ball.format('a')}{ball.format('b')}</worldbody></mujoco>"
    robot = robot_of(tmp_path, text)
    assert (robot.root, list(robot.joints)) == ("world", ["ja", "jb"])


def test_a_urdf_may_have_an_element_of_mujoco(tmp_path):
    text = '<robot name="r"><mujoco><compiler/></mujoco><link name="l"/></robot>'
    assert read_robot(save(tmp_path, text, "r.urdf")).format == "urdf"


def test_without_the_package_mujoco_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraMissing, match=r"arm\.xml needs mujoco, .*; pip install .*mujoco"):
        robot_of(tmp_path, part())
