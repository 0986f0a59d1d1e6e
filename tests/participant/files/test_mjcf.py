"""Models in MJCF are read as the URDF that says the same: compared with MuJoCo itself."""

import os
import struct
import sys

import numpy as np
import pytest
from support.mjcf import FINGER, SLIDE, converted, part, save

from stepbus_kinematics import RobotModel
from stepbus_participant import ExtraMissing, parse_urdf, read_urdf_text
from stepbus_participant.urdf_check import Mimic, mimics
from stepbus_plant.params import Params
from stepbus_plant.plant import SimulatedPlant
from stepbus_plant.world_file import load_world
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
<joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size=".2 .1 .1" mass="2"/>
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
@pytest.mark.parametrize("engine", ["mujoco"])
def test_it_swings_as_in_mujoco(tmp_path, name, engine):
    pytest.importorskip(engine, reason=f"{engine} is not installed")
    model, data = standing(MODELS[name])
    names = [model.joint(n).name for n in range(model.njnt)]
    start = np.random.default_rng(3).uniform(-0.8, 0.8, len(names))
    data.qpos[:] = start
    if name != "pole":
        # The world file, not the model, says how a root stands.
        model.body_quat[1] = (1, 0, 0, 0)
    mujoco.mj_step(model, data, 200)
    save(tmp_path, MODELS[name])
    rows = "".join(
        f"{n}: {{position: {q!r}}}, " for n, q in zip(names, start.tolist(), strict=True)
    )
    world = save(
        tmp_path,
        f"physics_step: 1ms\nengine: {engine}\n"
        f"bodies: {{arm: {{urdf: arm.xml, fixed_base: true, joints: {{{rows}}}}}}}",
        "world.yaml",
    )
    plant = SimulatedPlant(load_world(world), Params(world=world), 1_000_000, 0)
    for _ in range(200):
        plant.advance()
    states = dict(zip(plant.names, plant.sense().position, strict=True))
    assert abs(data.qpos - start).max() > 0.02
    assert [states[n] for n in names] == pytest.approx(data.qpos.tolist(), abs=1e-7)


def stl(vertices, triangles):
    """Return a binary STL."""
    rows = [struct.pack("<12fH", 0, 0, 0, *vertices[list(t)].ravel(), 0) for t in triangles]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


@pytest.mark.parametrize(
    "given",
    [
        'scale=".1 .2 -.3"',
        'scale=".1 .2 .3" refpos=".1 .2 .3"',
        'scale=".2 .2 .2" refpos=".1 .2 .3" refquat=".5 .1 .2 .3"',
    ],
)
def test_meshes_are_those_of_the_files_where_mujoco_has_them(tmp_path, monkeypatch, given):
    corners = np.random.default_rng(5).uniform(-1, 1, (4, 3)).astype(np.float32)
    sides = [(0, 1, 2), (0, 3, 1), (1, 3, 2), (0, 2, 3)]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/wedge.stl").write_bytes(stl(corners, sides))
    text = part(
        before='<compiler meshdir="../parts"/>'
        f'<asset><mesh name="wedge" file="wedge.stl" {given}/></asset>',
        body='<geom name="w" type="mesh" mesh="wedge" pos="1 2 3" euler="10 20 30" mass="1"/>',
    )
    path = save(tmp_path, text, "model/arm.xml")
    monkeypatch.chdir(tmp_path)
    text = read_urdf_text(path.relative_to(tmp_path))
    assert text == read_urdf_text(path)
    (mesh,) = parse_urdf(text).findall("link[@name='arm']/collision[@name='w']")
    assert mesh.find("geometry/mesh").get("filename") == "../parts/wedge.stl"
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
    robot = converted(tmp_path, part(f"<actuator>{actuators}</actuator>", joint=joint))
    assert float(robot.find("joint[@name='hinge']/limit").get("effort")) == effort


def test_limits_damping_friction_and_colours_are_taken(tmp_path):
    text = part(
        joint='range="-90 45" damping=".2" frictionloss=".3"',
        before='<asset><material name="red" rgba="1 0 0 1"/></asset>',
        solid='material="red" friction=".4 .02 .001" condim="4"',
    )
    robot = converted(tmp_path, text)
    joint, link = robot.find("joint[@name='hinge']"), robot.find("link[@name='arm']")
    assert joint.get("type") == "revolute"
    assert float(joint.find("limit").get("lower")) == pytest.approx(-np.pi / 2)
    assert joint.find("dynamics").attrib == {"damping": "0.2", "friction": "0.3"}
    assert link.find("visual/material/color").get("rgba") == "1.0 0.0 0.0 1.0"
    frictions = {row.tag: row.get("value") for row in link.find("contact")}
    assert frictions == {"lateral_friction": "0.4", "spinning_friction": "0.02"}


def test_a_slide_without_a_range_has_no_stops(tmp_path):
    text = part(body=FINGER.replace('range="0 1"', ""))
    robot = RobotModel(save(tmp_path, text), ["slide", "hinge"])
    assert robot.lower.tolist() == [-np.inf, -np.inf]
    assert robot.upper.tolist() == [np.inf, np.inf]
    with pytest.raises(WiringError, match=r"of arm\.xml has no position limits"):
        RobotModel(save(tmp_path, text), ["slide"], bounded=True)


def test_shapes_are_as_large_as_in_mujoco(tmp_path):
    shapes = ('box" size=".1 .2 .3', 'cylinder" size=".1 .2', 'capsule" size=".1 .2')
    robot = converted(tmp_path, part(body="".join(f'<geom type="{shape}"/>' for shape in shapes)))
    rows = robot.findall("link[@name='arm']/collision/geometry/*")[1:]
    assert [(row.tag, row.attrib) for row in rows] == [
        ("box", {"size": "0.2 0.4 0.6"}),
        ("cylinder", {"radius": "0.1", "length": "0.4"}),
        ("capsule", {"radius": "0.1", "length": "0.4"}),
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
    followers = mimics(converted(tmp_path, text))
    thirty, twenty = np.radians([30, 20])
    slide = Mimic(joint="hinge", multiplier=2.0, offset=0.1 - 2 * thirty)
    far = 0.5 + twenty + 3 * slide.offset
    assert followers["slide"] == slide
    assert (followers["far"].joint, followers["far"].multiplier) == ("hinge", 6.0)
    assert followers["far"].offset == pytest.approx(far)
    circle = rows.replace('joint2="hinge"', 'joint2="far"')
    with pytest.raises(WiringError, match="joint 'far' follows itself"):
        converted(tmp_path, text.replace(rows, circle))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco/>", "has 0 bodies in its <worldbody>"),
        (
            '<mujoco><worldbody><body name="a"/><body name="b"/></worldbody></mujoco>',
            "'a' 'b' in its <worldbody>",
        ),
        ("<mujoco><bod/></mujoco>", "MuJoCo cannot compile it: .*unrecognized element .*line 1"),
        ('<mujoco><include file="no.xml"/></mujoco>', "MuJoCo cannot compile it: .*'no.xml'"),
        ('<mujoco><include file="arm.xml"/></mujoco>', "compile it: .*already included"),
        ('<mujoco><include file="pipe"/></mujoco>', "'pipe' is not a regular file"),
        (
            '<mujoco><compiler meshdir="parts"/><asset><mesh file="../pipe"/></asset></mujoco>',
            "'../pipe' is not a regular file",
        ),
        ('<mujoco><asset><mesh file="no.stl"/></asset></mujoco>', "Error opening file .*no.stl"),
        ('<mujoco><include file="more.xml"/></mujoco>', "more.xml: '/dev/zero' is not a regular"),
        (
            part(body="<body><joint/></body>"),
            "mass and inertia of moving",
        ),
        (
            part(body='<body pos="nan 0 0"/>'),
            "xyz='nan 0.0 0.0' of <origin> is",
        ),
        ("<mujoco>", "arm.xml:1: is not XML"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*NaN")
def test_a_mistake_is_one_error(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "parts").mkdir()
    save(tmp_path, '<mujoco><include file="/dev/zero"/></mujoco>', "more.xml")
    with pytest.raises(WiringError, match=message):
        converted(tmp_path, text)


def test_files_that_are_included_are_read(tmp_path):
    save(tmp_path, '<mujoco><default><geom density="10"/></default></mujoco>', "parts/soft.xml")
    light = converted(tmp_path, part(before='<include file="parts/soft.xml"/>'))
    mass = float(light.find("link[@name='arm']/inertial/mass").get("value"))
    assert mass == pytest.approx(10 * 4 / 3 * np.pi * 0.1**3)


def test_models_that_are_attached_have_their_own_meshes(tmp_path):
    corners = np.eye(4, 3, dtype=np.float32)
    (tmp_path / "sub/parts").mkdir(parents=True)
    content = stl(corners, [(0, 1, 2), (0, 3, 1), (1, 3, 2), (0, 2, 3)])
    (tmp_path / "sub/parts/wedge.stl").write_bytes(content)
    finger = """<mujoco model="sub"><compiler meshdir="parts"/><asset><mesh file="wedge.stl"/></asset>
<worldbody><body name="finger"><joint name="f"/><geom type="mesh" mesh="wedge"/></body></worldbody>
</mujoco>"""
    save(tmp_path, finger, "sub/finger.xml")
    model = '<asset><model name="sub" file="sub/finger.xml"/></asset>'
    hands = "".join(f'<attach model="sub" body="finger" prefix="{n}_"/>' for n in ("left", "right"))
    robot = converted(tmp_path, part(before=model, body=hands))
    files = [mesh.get("filename") for mesh in robot.iterfind("link/collision/geometry/mesh")]
    assert files == ["sub/parts/wedge.stl"] * 2
    assert robot.find("joint[@name='right_f']/child").get("link") == "right_finger"


def test_a_urdf_may_have_an_element_of_mujoco(tmp_path):
    text = '<robot name="r"><mujoco><compiler/></mujoco><link name="l"/></robot>'
    assert read_urdf_text(save(tmp_path, text, "r.urdf")) == text


def test_without_the_package_mujoco_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraMissing, match=r"arm\.xml needs mujoco, .*; pip install .*mujoco"):
        converted(tmp_path, part())
