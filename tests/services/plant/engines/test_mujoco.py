"""What is particular to the engine MuJoCo: its refusals, its pictures, its state."""

import os
import subprocess
import sys

import pytest
from support.services.devices import box, link, make_stand, write_gripper
from support.tools import needs_opengl

from stepbus_participant import Problems
from stepbus_plant.engine import Light
from stepbus_plant.geometry import projection_matrix, view_matrix
from stepbus_plant.params import Params
from stepbus_plant.physics import Physics
from stepbus_plant.world_file import load_world
from stepbus_schemas import GripperCommand, JointCommand, WiringError

pytest.importorskip("mujoco", reason="the engine MuJoCo is not installed")


def load(folder, urdf, world="bodies: {one: {urdf: one.urdf}}"):
    """Return a world with one body in MuJoCo."""
    (folder / "one.urdf").write_text(f'<robot name="one">{urdf}</robot>')
    (folder / "world.yaml").write_text(f"engine: mujoco\n{world}")
    file = folder / "world.yaml"
    return Physics(load_world(file), 10**6, Params(world=file), Problems())


@pytest.mark.parametrize(
    ("found", "sentence"),
    [
        ("<torus radius='1'/>", "link 'base': a <collision> is a <torus>"),
        ("<box size='1 2'/>", "size='1 2' of <box> must be 3 finite numbers"),
        ("<box size='1 0 1'/>", "size 1 must be positive"),
        ("<sphere radius='x'/>", "radius='x' of <sphere> must be a finite number"),
        ('<plane normal="0 0 1"/>', "link 'base': engine mujoco does not support a `<plane>`"),
    ],
)
def test_a_shape_that_it_does_not_know_is_refused_with_its_file(tmp_path, found, sentence):
    with pytest.raises(WiringError) as refused:
        load(tmp_path, link("base", 1.0, found))
    assert "world.yaml:2: bodies.one.urdf: " in str(refused.value)
    assert sentence in str(refused.value)


def test_what_is_half_transparent_is_seen(tmp_path):
    needs_opengl("mujoco")
    red = '<visual><geometry><box size="1 1 1"/></geometry><material name="red">{}</material></visual>'
    urdf = link("base", 1.0, box("1 1 1"), more=red.format('<color rgba="1 0 0 0.5"/>'))
    engine = load(tmp_path, urdf).engine
    light = Light(
        direction=(0, 0, 1), distance=1, ambient=1, diffuse=0, specular=0, has_shadow=False
    )
    view = view_matrix((0.0, 0.0, 0.0), 2.0, 0.0, 0.0)
    colours, depth = engine.image((9, 9), view, projection_matrix(0.5, 1.0, 0.1, 5.0), light)
    assert colours[4, 4].tolist() == [255, 0, 0]
    assert depth[4, 4] < 1.0


SEE = """
import numpy as np
from stepbus_plant.engine import Light
from stepbus_plant.engines import open_engine
engine = open_engine("mujoco", 1e-3, (0.0, 0.0, -9.81), 50)
engine.image((8, 8), np.eye(4), np.eye(4), Light(direction=(0, 0, 1), distance=1, ambient=1,
             diffuse=0, specular=0, has_shadow=False))
"""


@pytest.mark.parametrize("kind", ["osmesa", "nothing"])
def test_without_a_renderer_it_says_what_to_install(kind):
    if kind == "osmesa" and has_osmesa():
        pytest.skip("OSMesa is installed")
    environment = {**os.environ, "MUJOCO_GL": kind}
    environment.pop("PYOPENGL_PLATFORM", None)
    tried = subprocess.run(
        [sys.executable, "-c", SEE],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert tried.returncode == 1
    last = tried.stderr.strip().splitlines()[-1]
    assert f"cannot render images with MUJOCO_GL={kind}" in last
    assert "install libegl1" in last
    assert "`cameras: false`" in last


def has_osmesa():
    from ctypes.util import find_library  # noqa: PLC0415

    return find_library("OSMesa") is not None


HOLDS = """
engine: mujoco
grippers: {gripper: {left: left, right: right}}
contacts: {touch: {links: [left_pad, right_pad, can], within: 0.02}}
imus: {shaken: {link: can, noise: {linear_acceleration: 0.01}}}
lidars: {scan: {link: left_pad, rays: 5, noise: 0.01}}
transforms: {seen: {links: [can], noise: {position: 0.001}}}
wrenches: {felt: {joint: lift, noise: {force: 0.1}}}
cameras: {eye: {link: left_pad, width: 32, height: 24, period: 100ms}}
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  gripper:
    urdf: gripper.urdf
    position: [0, 0, 0.1575]
    fixed_base: true
    joint_defaults: {mode: velocity}
    joints: {left: {position: 0.045}, right: {position: 0.045}}
  can: {urdf: can.urdf, position: [0, 0, 0.0575]}
"""
SHOWS = {
    "gripper": "GripperState/1",
    "touch": "Contacts/1",
    "shaken": "Imu/1",
    "scan": "LaserScan/1",
    "seen": "Transforms/1",
    "felt": "Wrench/1",
    "truth": "Poses/1",
    "rgb": "Image/1",
}
ASKED = {
    1: {"gripper": GripperCommand(width=0.0, force=15.0)},
    60: {"lift": JointCommand(mode="velocity", values=[0.1])},
    110: {"gripper": GripperCommand(width=0.1, force=15.0)},
}


def hold(folder):
    write_gripper(folder)
    inputs = {"gripper": "GripperCommand/1", "lift": "JointCommand/1"}
    errors = {"noise": 0.1, "gain": 0.1}
    return make_stand(folder, HOLDS, SHOWS, inputs, proximity=errors, lift=["lift"])


@pytest.mark.slow
def test_a_plant_restored_in_the_middle_of_a_grasp_goes_on_to_the_bit_with_all_its_devices(
    tmp_path,
):
    stand, shown, saved = hold(tmp_path), {}, {}
    for step in range(140):
        if step in (20, 55, 80, 115):
            saved[step] = stand.participant.save()
        shown[step] = stand.participant.output(None)
        stand.update(step, **ASKED.get(step, {}))
    assert [shown[step]["gripper"].holding for step in (20, 55, 80, 139)] == [
        False, True, True, False,
    ]  # fmt: skip
    for start, state in saved.items():
        again = hold(tmp_path)
        again.participant.restore(state)
        for step in range(start, 140):
            assert again.participant.output(None) == shown[step], (start, step)
            again.update(step, **ASKED.get(step, {}))
