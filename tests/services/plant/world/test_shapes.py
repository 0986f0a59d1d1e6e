from types import SimpleNamespace

import numpy as np
import pytest
from support.services.devices import joint, link, make_stand, write_urdf

from stepbus_plant import load_world
from stepbus_plant.params import Params
from stepbus_plant.plant import SimulatedPlant
from stepbus_plant.poses import PoseSensor

WORLD = """
bodies:
  one: {urdf: thing.urdf, fixed_base: true}
  two: {urdf: thing.urdf, fixed_base: true, visuals: false, position: [5, 0, 0]}
"""
RED = '<material name="red"><color rgba="0.8 0.1 0 1"/></material>'
VISUAL = '<visual><geometry><sphere radius="1"/></geometry><material name="red"/></visual>'
TETRAHEDRON = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""
SHAPES = {
    '<box size="1 2.5 3"/>': "box 1 2.5 3",
    '<cylinder radius="0.033" length="0.115"/>': "cylinder 0.033 0.115",
    '<sphere radius="0.2"/>': "sphere 0.2",
    '<capsule radius="0.2" length="1"/>': "capsule 0.2 1",
    '<mesh filename="tetrahedron.obj"/>': "mesh",
}


def describe(folder, shape='<box size="1 1 1"/>', at="0 0 0", more="", links=None, types=None):
    """Return what a plant with two bodies of a base and an arm tells of its links."""
    base = link("base", 1.0, shape, at, more)
    arm = joint("turn", "revolute", "base", "arm", "0 0 1", "0 0 1", "1 1 -1 1")
    (folder / "tetrahedron.obj").write_text(TETRAHEDRON)
    write_urdf(folder, "thing", RED, base, f'<link name="arm">{VISUAL}</link>', arm)
    (folder / "world.yaml").write_text(WORLD)
    world = load_world(folder / "world.yaml")
    plant = SimulatedPlant(world, Params(world="world.yaml"), 1_000_000, 0)
    items = {body: SimpleNamespace(type=name) for body, name in (types or {}).items()}
    world.items.update(items)
    try:
        return PoseSensor(plant.physics, links).description
    finally:
        plant.close()


@pytest.mark.parametrize(("shape", "text"), SHAPES.items())
def test_a_shape_is_told_as_the_urdf_has_it(tmp_path, shape, text):
    assert describe(tmp_path, shape).details["shape"][0] == f"{text} @ 0 0 0 0 0 0 1"


def test_several_shapes_of_a_link_are_told_with_how_they_are_turned(tmp_path):
    turned = '<origin xyz="0 0 2" rpy="0 0 1.5707963267948966"/><geometry><sphere radius="1"/>'
    more = f"<collision>{turned}</geometry></collision>"
    first, second = describe(tmp_path, more=more).details["shape"][0].split("; ")
    assert first == "box 1 1 1 @ 0 0 0 0 0 0 1"
    assert second.startswith("sphere 1 @ 0 0 2 ")
    quaternion = [float(word) for word in second.split()[-4:]]
    assert quaternion == pytest.approx([0, 0, np.sqrt(0.5), np.sqrt(0.5)], abs=1e-9)


def test_every_link_tells_its_body_kind_and_color(tmp_path):
    said = describe(tmp_path, types={"two": "cola"})
    assert said.names == ["one/base", "one/arm", "two/base", "two/arm"]
    assert said.details["body"] == ["one", "one", "two", "two"]
    assert said.details["type"] == ["", "", "cola", "cola"]
    # The arm has no shape to touch; of the second body nothing is to be seen.
    assert said.details["color"] == ["", "0.8 0.1 0", "", ""]
    assert [bool(shape) for shape in said.details["shape"]] == [True, False, True, False]


def test_details_are_in_the_order_of_the_links_that_are_asked_for(tmp_path):
    said = describe(tmp_path, links=["two/arm", "one/base"])
    assert said.names == ["two/arm", "one/base"]
    assert said.details["body"] == ["two", "one"]


def test_joints_tell_which_device_they_are_of(tmp_path):
    world = """
grippers: {gripper: {left: a, right: b}}
bodies: {one: {urdf: thing.urdf, fixed_base: true, joint_defaults: {mode: velocity}}}
"""
    parts = [link(name, 1.0, '<sphere radius="0.01"/>') for name in ("base", "l", "m", "r")]
    slides = [
        joint(n, "prismatic", "base", c, "0 0 0", "0 1 0", "9 1 0 1")
        for n, c in (("a", "l"), ("x", "m"), ("b", "r"))
    ]
    write_urdf(tmp_path, "thing", *parts, *slides)
    outputs = {"joint_state": "JointState/1", "gripper": "GripperState/1"}
    said = make_stand(tmp_path, world, outputs, {}).participant.describe()
    assert said["joint_state"].names == ["a", "x", "b"]
    assert said["joint_state"].details["device"] == ["gripper", "", "gripper"]
    assert said["gripper"].names == ["a", "b"]
    assert said["gripper"].limits["effort"] == [9.0, 9.0]
