"""Checkpoints of the plant: equal to the bit for thousands of steps, or none."""

import math
from contextlib import closing

import pytest
from support.services.plant import TWO_LINK
from support.tools import needs_pybullet

from stepbus_plant.params import Params
from stepbus_plant.plant import SimulatedPlant
from stepbus_plant.world_file import load_world
from stepbus_schemas import JointCommand

PERIOD_NS = 5_000_000
WORLD = """
gravity: [0, 0, -9.81]
bodies:
  arm:
    urdf: ARM
    fixed_base: FIXED
    joint_defaults: {mode: MODE, lower: -0.4, upper: 0.4}
    joints: {joint2: {position: 0.3}}
"""
BLOCK = """
  block: {urdf: block.urdf, fixed_base: true, position: [0, 0, -0.5]}
"""
BLOCK_URDF = """<robot name="block"><link name="block"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><box size="4 4 0.2"/></geometry></collision></link></robot>"""
SHAPE = (
    '<collision><origin xyz="0.5 0 0"/><geometry><box size="0.9 0.1 0.1"/></geometry></collision>'
)


def make(folder, mode="torque", *, fixed=True, block=False, engine=None):
    """Return an arm with stops, which has a block beneath it or not."""
    text = TWO_LINK.read_text()
    for link in ("link1", "link2"):
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{SHAPE}')
    (folder / "arm.urdf").write_text(text)
    (folder / "block.urdf").write_text(BLOCK_URDF)
    world = WORLD.replace("ARM", "arm.urdf").replace("FIXED", str(fixed).lower())
    path = folder / "world.yaml"
    path.write_text(world.replace("MODE", mode) + (BLOCK if block else ""))
    params = Params(world=path, engine=engine)
    return SimulatedPlant(load_world(path), params, PERIOD_NS, seed=1)


def commander(plant):
    return plant.commander("command", plant.names)


def advance(plant, driver, first, last):
    """Return what is sensed at each step, to the bit."""
    found = []
    for k in range(first, last):
        found.append(plant.sense())
        mode = next(iter(plant.physics.joints.values())).mode
        scale = {"torque": 20.0, "velocity": 1.0, "position": 0.3}[mode]
        values = [scale * math.sin(0.01 * k + i) for i in range(2)]
        if k % 3 == 0:
            driver.apply(JointCommand(mode=mode, values=values))
        driver.before_step()
        plant.advance()
    return found


@pytest.mark.parametrize("mode", ["torque", "velocity", "position"])
@pytest.mark.parametrize("at", [1, 700])
def test_a_restored_plant_goes_on_to_the_bit(tmp_path, mode, at):
    with closing(make(tmp_path, mode)) as plant, closing(make(tmp_path, mode)) as other:
        first, second = commander(plant), commander(other)
        advance(plant, first, 0, at)
        other.restore(plant.save())
        second.state = first.state
        assert advance(other, second, at, at + 3000) == advance(plant, first, at, at + 3000)


def shape(kind, more=""):
    """Return the URDF of a body of 1 kg; kind: of its shape."""
    return BLOCK_URDF.replace('<box size="4 4 0.2"/>', kind).replace("</link>", f"{more}</link>")


def scene(folder, rows, files):
    """Return a world of free bodies above a floor, and its bodies' poses after each step."""
    (folder / "floor.urdf").write_text(BLOCK_URDF)
    for name, text in files.items():
        (folder / name).write_text(text)
    path = folder / "world.yaml"
    path.write_text(f"""
engine: pybullet
gravity: [0, 0, -9.81]
bodies:
  floor: {{urdf: floor.urdf, fixed_base: true, position: [0, 0, -0.1]}}
{rows}
""")
    return SimulatedPlant(load_world(path), Params(world=path), PERIOD_NS, seed=1)


def fall(plant, steps):
    """Return where all bodies are after each step, to the bit."""
    found = []
    for _ in range(steps):
        plant.advance()
        engine = plant.physics.engine
        found.append(([engine.centre(body) for body in range(5)], engine.contacts()))
    return found


PILE = "".join(
    f"  b{n}: {{urdf: {urdf}, position: [{0.01 * n}, 0.02, {0.1 + 0.22 * n}], "
    f"orientation_rpy: [{0.1 * n}, 0.2, 0]}}\n"
    for n, urdf in enumerate(("box.urdf", "ball.urdf", "rod.urdf", "box.urdf"))
)
SHAPES = {
    "box.urdf": shape('<box size="0.3 0.3 0.2"/>'),
    "ball.urdf": shape('<sphere radius="0.1"/>'),
    "rod.urdf": shape('<capsule radius="0.1" length="0.2"/>'),
}


@needs_pybullet
@pytest.mark.parametrize("at", [1, 40, 90, 300])
def test_a_pile_goes_on_to_the_bit(tmp_path, at):
    with (
        closing(scene(tmp_path, PILE, SHAPES)) as plant,
        closing(scene(tmp_path, PILE, SHAPES)) as other,
    ):
        fall(plant, at)
        other.restore(plant.save())
        assert other.physics.engine.contacts() == plant.physics.engine.contacts()
        went = fall(plant, 500)
        assert fall(other, 500) == went
    assert max(len(contacts) for _, contacts in went) > 4


@needs_pybullet
@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("mode", ["torque", "position"])
def test_an_arm_that_touches_something_goes_on_to_the_bit(tmp_path, mode, fixed):
    kind = {"fixed": fixed, "block": True, "engine": "pybullet"}
    with (
        closing(make(tmp_path, mode, **kind)) as plant,
        closing(make(tmp_path, mode, **kind)) as other,
    ):
        first, second = commander(plant), commander(other)
        while not plant.physics.engine.contacts(are_pressed=True):
            advance(plant, first, plant.t_ns // PERIOD_NS, plant.t_ns // PERIOD_NS + 1)
        at = plant.t_ns // PERIOD_NS
        other.restore(plant.save())
        second.state = first.state
        assert advance(other, second, at, at + 500) == advance(plant, first, at, at + 500)


@needs_pybullet
def test_the_reaction_of_a_joint_is_the_one_before(tmp_path):
    with (
        closing(make(tmp_path, engine="pybullet")) as plant,
        closing(make(tmp_path, engine="pybullet")) as other,
    ):
        joint = plant.physics.all_joints()["joint1"]
        for one in (plant, other):
            one.physics.engine.watch_reaction(joint)
        advance(plant, commander(plant), 0, 50)
        other.restore(plant.save())
        for _ in range(2):
            felt = [one.physics.engine.reaction(joint) for one in (plant, other)]
            assert felt[0][0].any()
            assert str(felt[0]) == str(felt[1])
            plant.advance()
            other.advance()


TWO = '<collision><origin xyz="0 0 0.2"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
PARTS = "".join(
    f"o part{n}\nv 0 0 {n}\nv 1 0 {n}\nv 0 1 {n}\nv 0 0 {n}.5\n"
    + "".join(f"f {' '.join(str(4 * n + i) for i in face)}\n" for face in ((1, 2, 3), (1, 2, 4)))
    for n in range(2)
)


@needs_pybullet
@pytest.mark.parametrize(
    ("urdf", "files"),
    [
        (shape('<box size="0.2 0.2 0.2"/>', TWO), {}),
        (shape('<mesh filename="m.obj"/>'), {"m.obj": PARTS}),
    ],
)
def test_a_link_of_several_shapes_is_not_saved_while_it_is_touched(tmp_path, urdf, files):
    rows = "  thing: {urdf: thing.urdf, position: [0, 0, 0.3]}"
    with closing(scene(tmp_path, rows, {"thing.urdf": urdf, **files})) as plant:
        assert plant.unsaved() == ""
        for _ in range(100):
            plant.advance()
        assert plant.unsaved() == (
            "PyBullet does not keep the contacts of thing, which has a link with several shapes or "
            "a concave one"
        )


@needs_pybullet
def test_a_body_that_may_sleep_is_not_saved(tmp_path):
    rows = "  thing: {urdf: box.urdf, position: [0, 0, 0.3]}\nsleeping: true"
    with closing(scene(tmp_path, rows, SHAPES)) as plant:
        assert plant.unsaved() == (
            "PyBullet does not keep how long thing has been at rest (`sleeping`)"
        )
