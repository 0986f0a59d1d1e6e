"""An MJCF in MuJoCo: as it is, with all that it has; with PyBullet it is refused."""

import math

import numpy as np
import pytest
from support.services.mechanics import MS, advance, command, state

from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_plant.engine import BASE
from stepbus_schemas import WiringError

mujoco = pytest.importorskip("mujoco", reason="the engine MuJoCo is not installed")

FIXED = "fixed_base: true"
OPTION = '<option timestep="0.001" integrator="implicitfast"/>'
BASE_WITH = '<body name="base"><geom size=".1" contype="0" conaffinity="0"/>{}</body>'


def model(inside, extra="", before=""):
    """Return an MJCF of a base with something in it."""
    root = BASE_WITH.format(inside)
    return f"<mujoco>{before}{OPTION}<worldbody>{root}</worldbody>{extra}</mujoco>"


def plant_of(folder, text, keys=FIXED, engine="mujoco", world=""):
    """Return a plant of one body."""
    (folder / "arm.xml").write_text(text)
    (folder / "world.yaml").write_text(f"{world}\nbodies:\n  arm: {{urdf: arm.xml, {keys}}}\n")
    params = Params.of({"world": "world.yaml", "engine": engine})
    return SimulatedPlant(load_world(folder / "world.yaml"), params, MS, 0)


ARM = '<body name="arm"><joint name="hinge" axis="0 1 0" {}/><geom size=".1" pos=".5 0 0" {}/>{}</body>'
FREE = 'contype="0" conaffinity="0"'


def arm(joint="", inside="", geom=FREE):
    """Return a link on a hinge."""
    return ARM.format(joint, geom, inside)


FOREARM = """<body name="forearm" pos="1 0 0"><joint name="elbow" axis="0 1 0"/>
<geom size=".1" pos="0 0 -.2" contype="0" conaffinity="0"/></body>"""
LOOP = """<body name="other" pos="0 0 -.3"><joint name="lower" axis="0 1 0"/>
<geom size=".1" pos=".5 0 0" contype="0" conaffinity="0"/></body>"""
PASSIVE = {
    "a spring": model(arm('stiffness="30" damping=".2" armature=".1" frictionloss=".3"')),
    "a tendon": model(
        arm(),
        '<tendon><fixed name="t" stiffness="40" damping="1"><joint joint="hinge" coef="2"/></fixed></tendon>',
    ),
    "a ball joint": model(
        arm(inside=f'<body pos="1 0 0"><joint type="ball"/><geom size=".05" pos=".2 .1 0" {FREE}/></body>')
    ),
    "a closed loop": model(
        arm(inside=FOREARM) + LOOP,
        '<equality><connect body1="forearm" body2="other" anchor="0 0 -.3"/></equality>',
    ),
    "three hinges in a body": model(
        '<body name="wrist"><joint axis="1 0 0"/><joint axis="0 1 0"/><joint axis="0 0 1"/>'
        f'<geom size=".1" pos=".2 .1 0" {FREE}/></body>'
    ),
    "degrees and an angle of its own": model(
        arm('ref="20" springref="10" stiffness="5" range="-60 60"'),
        before='<compiler angle="degree"/>',
    ),
    "a muscle": model(
        arm("range='-1 1'"), '<actuator><muscle joint="hinge" name="m" force="100"/></actuator>',
        before='<compiler angle="radian"/>',
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", PASSIVE.values(), ids=PASSIVE)
def test_what_it_has_moves_as_mujoco_alone_moves_it(tmp_path, text):
    plant = plant_of(tmp_path, text)
    alone = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data = mujoco.MjData(alone)
    # stepbus starts a joint at 0, wherever MJCF draws it.
    data.qpos[alone.jnt_qposadr[alone.jnt_type != mujoco.mjtJoint.mjJNT_BALL]] = 0.0
    advance(plant, 500)
    for _ in range(500):
        mujoco.mj_step(alone, data)
    mujoco.mj_kinematics(alone, data)
    assert np.abs(data.qvel).max() > 1e-2
    for number, link in enumerate(plant.physics.links.values(), 1):
        place, turn = plant.physics.engine.frame(link)
        np.testing.assert_allclose(place, data.xpos[number], atol=1e-9)
        np.testing.assert_allclose(turn, np.roll(data.xquat[number], -1), atol=1e-9)


def test_joints_of_one_degree_of_freedom_have_names_and_commands(tmp_path):
    inside = (
        '<body name="wrist"><joint name="roll" axis="1 0 0"/><joint name="rail" type="slide"/>'
        '<geom size=".1"/><body name="ball"><joint name="ball" type="ball"/><geom size=".1"/></body></body>'
    )
    plant = plant_of(tmp_path, model(inside), f"{FIXED}, joint_defaults: {{mode: position}}")
    assert list(plant.physics.joints) == ["roll", "rail"]
    assert list(plant.physics.links) == ["base", "wrist", "ball"]
    command(plant, "position", 0.4, 0.1)
    advance(plant, 1000)
    assert state(plant, "roll")[0] == pytest.approx(0.4, abs=1e-3)
    assert state(plant, "rail")[0] == pytest.approx(0.1, abs=1e-3)


def test_actuators_of_joints_are_the_limits_of_their_motors(tmp_path):
    extra = (
        '<actuator><position joint="hinge" kp="9" forcerange="-20 30"/>'
        '<motor joint="hinge" gear="-2" ctrlrange="-5 4"/><motor name="pull" tendon="t"/></actuator>'
        '<tendon><fixed name="t"><joint joint="hinge" coef="1"/></fixed></tendon>'
    )
    plant = plant_of(tmp_path, model(arm(), extra))
    assert plant.physics.joints["hinge"].effort == 30.0 + 2 * 5.0
    (note,) = [text for _, text in plant.physics.notes]
    assert note == "actuators that act on no joint are off: pull"
    (tmp_path / "own").mkdir()
    limited = plant_of(tmp_path / "own", model(arm('actuatorfrcrange="-4 3"'), extra))
    assert limited.physics.joints["hinge"].effort == 4.0


def test_a_coupled_joint_follows_without_a_motor(tmp_path):
    extra = '<equality><joint joint1="lower" joint2="hinge" polycoef=".1 -2 0 0 0"/></equality>'
    keys = f"{FIXED}, joint_defaults: {{mode: velocity}}"
    plant = plant_of(tmp_path, model(arm() + LOOP, extra), keys)
    follower = plant.physics.joints["lower"]
    assert (follower.motor, follower.start) == (False, 0.1)
    plant.commander("command", ["hinge"])
    advance(plant, 300)
    leader = state(plant, "hinge")[0]
    assert state(plant, "lower")[0] == pytest.approx(0.1 - 2 * leader, abs=5e-3)


def test_stops_of_the_world_file_go_over_those_in_degrees(tmp_path):
    text = model(arm('range="-60 60"'))
    plant = plant_of(tmp_path, text, f"{FIXED}, joints: {{hinge: {{lower: -0.1, upper: 0.2}}}}")
    advance(plant, 3000)
    assert state(plant, "hinge")[0] == pytest.approx(0.2, abs=5e-3)
    (tmp_path / "own").mkdir()
    own = plant_of(tmp_path / "own", text)
    assert own.physics.joints["hinge"].upper == pytest.approx(math.radians(60))


def test_its_damping_is_used_unless_the_world_file_has_another_one(tmp_path):
    text = model(arm('damping="3"'))
    assert plant_of(tmp_path, text).physics.joints["hinge"].damping == 3.0
    (tmp_path / "own").mkdir()
    plant = plant_of(tmp_path / "own", text, f"{FIXED}, joint_defaults: {{damping: 0.5}}")
    assert plant.physics.joints["hinge"].damping == 0.5


def test_its_masks_decide_what_collides(tmp_path):
    """A ball behind a slide falls on another one of the same robot; links of a URDF would pass."""
    ball = '<body pos="0 0 .5"><joint type="slide" name="down"/><geom size=".1" mass="1"/></body>'
    rail = f'<joint type="slide" range="0 1"/><geom size=".01" pos="1 0 0"/>{ball}'
    root = f'<body name="base"><geom size=".2"/><body name="rail">{rail}</body></body>'
    plant = plant_of(tmp_path, f"<mujoco>{OPTION}<worldbody>{root}</worldbody></mujoco>")
    advance(plant, 2000)
    assert state(plant, "down")[0] == pytest.approx(-0.2, abs=2e-3)


def test_a_root_that_moves_in_the_world_has_it_as_its_base(tmp_path):
    text = f'<mujoco>{OPTION}<worldbody><body name="cart" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody></mujoco>'
    plant = plant_of(tmp_path, text, f"{FIXED}, position: [0, 2, 0]")
    assert list(plant.physics.links) == ["world", "cart"]
    frame = plant.physics.engine.frame(plant.physics.links["cart"])
    assert frame[0] == pytest.approx((0, 2, 1))
    (tmp_path / "free").mkdir()
    with pytest.raises(WiringError, match=r"arm\.xml.*set `fixed_base: true`|fixed_base"):
        plant_of(tmp_path / "free", text, "")


@pytest.mark.parametrize("joint", ["", "<freejoint/>"])
def test_without_a_fixed_base_it_falls_from_where_the_world_file_has_it(tmp_path, joint):
    text = f'<mujoco>{OPTION}<worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="dog" pos="3 3 3">{joint}<geom size=".1"/></body></worldbody></mujoco>'
    plant = advance(plant_of(tmp_path, text, "position: [1, 2, 3]"), 100)
    x, y, z = plant.physics.engine.frame((0, BASE))[0]
    assert (x, y) == (1.0, 2.0)
    assert z == pytest.approx(3.0 - 9.81 * 1e-6 * 100 * 101 / 2)
    assert [text for _, text in plant.physics.notes] == ["geoms of its <worldbody> are left out"]


def test_what_flies_in_a_world_of_several_bodies_flies_over_its_terrain(tmp_path):
    text = (
        f'<mujoco>{OPTION}<asset><hfield name="hills" nrow="2" ncol="2" size="9 9 1 1"/></asset>'
        '<worldbody><geom type="hfield" hfield="hills"/><body><geom size=".1"/></body>'
        '<body name="ball" pos="0 0 3"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    plant = advance(plant_of(tmp_path, text, f"{FIXED}, position: [1, 2, 0]"), 100)
    ball = plant.physics.engine.frame(plant.physics.links["ball"])[0]
    assert ball == pytest.approx((1.0, 2.0, 3.0 - 9.81 * 1e-6 * 100 * 101 / 2))


def test_pybullet_refuses_it_in_one_sentence(tmp_path):
    pytest.importorskip("pybullet")
    with pytest.raises(WiringError) as refused:
        plant_of(tmp_path, model(arm()), engine="pybullet")
    sentence = "is an MJCF, which engine pybullet does not read; use `engine: mujoco`"
    assert str(refused.value).endswith(sentence)


def test_what_mujoco_cannot_compile_is_named_with_its_file(tmp_path):
    with pytest.raises(WiringError, match=r"world\.yaml:.*bodies\.arm\.urdf: .*arm\.xml: MuJoCo"):
        plant_of(tmp_path, model('<body><joint type="hinge"/></body>'))


def test_a_state_of_it_is_restored_to_the_bit(tmp_path):
    text = PASSIVE["a closed loop"]
    plant = advance(plant_of(tmp_path, text), 100)
    saved = plant.physics.engine.save()
    (tmp_path / "again").mkdir()
    again = plant_of(tmp_path / "again", text)
    again.physics.engine.restore(saved)
    first, second = (advance(each, 200).sense() for each in (plant, again))
    assert first == second
