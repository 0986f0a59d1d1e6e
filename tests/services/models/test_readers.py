"""Where readers of URDF differ, all get the same robot: the description, and the URDF made of it."""

from dataclasses import replace
from pathlib import Path

import pytest
from support.tools import needs_robots

from stepbus_models import Inertial, Mimic, Pose, read_robot, urdf_text
from stepbus_participant import package_path

MOMENTS = '<inertia ixx="2" iyy="2" izz="3" ixy="0.1" ixz="0.2" iyz="0.3"/>'
INERTIAL = f'<inertial><origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><mass value="2"/>{MOMENTS}</inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="3"/>'
SHAPE = '<visual><geometry><box size="1 2 3"/></geometry><material name="paint"/></visual>'
ARM = f"""<robot name="r"><material name="paint"><color rgba="1 0 0 1"/></material>
<link name="base"/><link name="arm">{INERTIAL}{SHAPE}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>{LIMIT}
</joint></robot>"""


def read(folder: Path, before="", after=""):
    assert before in ARM
    path = folder / "r.urdf"
    path.write_text(ARM.replace(before, after))
    return read_robot(path)


def test_a_link_without_an_inertial_has_none(tmp_path):
    robot = read(tmp_path)
    assert robot.links["base"].inertial is None
    pose = Pose(xyz=(0, 0, 1), rpy=(0.1, 0.2, 0.3))
    moments = (2, 2, 3, 0.1, 0.2, 0.3)
    assert robot.links["arm"].inertial == Inertial(mass=2, moments=moments, pose=pose)


def test_a_material_that_is_defined_once_is_used_by_name(tmp_path):
    (seen,) = read(tmp_path).links["arm"].visuals
    assert (seen.rgba, seen.size) == ((1, 0, 0, 1), (1, 2, 3))


def test_a_follower_names_its_joint(tmp_path):
    more = f"""<link name="tip">{INERTIAL}</link><joint name="k" type="prismatic"><parent link="arm"/>
<child link="tip"/>{LIMIT}<mimic joint="j" multiplier="-0.5"/></joint></robot>"""
    assert read(tmp_path, "</robot>", more).joints["k"].mimic == Mimic(joint="j", multiplier=-0.5)


@pytest.mark.parametrize(
    "name", ["part one.stl", "file://{}/part%20one.stl", "package://my_arm/part one.stl"]
)
@pytest.mark.parametrize("scale", ["2", "1 -1 1"])
def test_a_mesh_has_an_absolute_path_and_three_factors(tmp_path, name, scale):
    folder = tmp_path / "my_arm"
    folder.mkdir()
    (folder / "part one.stl").touch()
    mesh = f'<mesh filename="{name.format(folder)}" scale="{scale}"/>'
    (shape, *_) = read(folder, '<box size="1 2 3"/>', mesh).links["arm"].visuals
    assert shape.mesh == str(folder / "part one.stl")
    assert shape.size == ((2, 2, 2) if scale == "2" else (1, -1, 1))


def test_a_mesh_that_is_not_there_keeps_its_name_and_line(tmp_path):
    robot = read(tmp_path, '<box size="1 2 3"/>', '<mesh filename="package://none/a.stl"/>')
    (shape,) = robot.links["arm"].visuals
    assert (shape.mesh, robot.place(shape.line)) == ("package://none/a.stl", f"{robot.path}:2")


@pytest.mark.parametrize(
    "url",
    [
        "package://stepbus_scenarios/two_link/two_link.urdf",
        pytest.param(
            "package://example-robot-data/robots/baxter_description/urdf/baxter.urdf",
            marks=needs_robots,
        ),
        pytest.param(
            "package://example-robot-data/robots/tiago_description/robots/tiago.urdf",
            marks=needs_robots,
        ),
    ],
)
def test_what_is_written_is_read_as_the_same_robot(tmp_path, url):
    robot = read_robot(package_path(url))
    path = tmp_path / "r.urdf"
    path.write_text(urdf_text(robot))
    assert max(map(len, path.read_text().splitlines())) < 1000
    again = read_robot(path)
    assert again.joints == {
        n: replace(j, line=again.joints[n].line) for n, j in robot.joints.items()
    }
    assert [link.inertial for link in again.links.values()] == [
        link.inertial for link in robot.links.values()
    ]
    sizes = [[s.size for s in (*k.visuals, *k.collisions)] for k in robot.links.values()]
    assert sizes == [[s.size for s in (*k.visuals, *k.collisions)] for k in again.links.values()]
