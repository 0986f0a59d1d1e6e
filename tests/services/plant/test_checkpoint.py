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


@needs_pybullet
def test_a_plant_that_touches_something_saves_nothing_until_it_is_free(tmp_path):
    with closing(make(tmp_path, block=True, engine="pybullet")) as plant:
        driver = commander(plant)
        saved = []
        for k in range(100):
            advance(plant, driver, k, k + 1)
            saved.append(plant.save() is not None)
    assert saved[0]
    assert not all(saved)


@needs_pybullet
def test_a_body_that_may_move_is_not_saved(tmp_path):
    with closing(make(tmp_path, fixed=False, engine="pybullet")) as plant:
        assert plant.save() is None
