"""A URDF that no physics can move is refused, each mistake with file, line, and name."""

import re
from importlib import resources
from pathlib import Path

import pytest
from support.tools import needs_pybullet, needs_robots

from stepbus_models import read_robot
from stepbus_orchestrator.cli import main
from stepbus_participant import package_path
from stepbus_schemas import WiringError

LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="3"/>'
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
ARM = f"""<robot name="r">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 1"/>
<mass value="2"/>
{INERTIA}</inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
{LIMIT}
</joint>
</robot>"""


def problems(folder, text, name="r.urdf"):
    """Return what is wrong with a robot: `line: sentence` each."""
    path = folder / name
    path.write_text(text)
    try:
        read_robot(path)
    except WiringError as exc:
        return [line.removeprefix(str(path)).removeprefix(":") for line in str(exc).split("\n")]
    return []


MASS = "4: link 'arm': value="
LEAST = "of <mass> must be a finite number, at least 0"
CASES = {
    "mass -1": ('value="2"', 'value="-1"', f"{MASS}'-1' {LEAST}"),
    "heavy": ('value="2"', 'value="heavy"', f"{MASS}'heavy'"),
    "NaN": ('value="2"', 'value="nan"', f"{MASS}'nan'"),
    "too large": ('value="2"', 'value="1e999"', f"{MASS}'1e999'"),
    "decimal comma": ('value="2"', 'value="1,5"', f"{MASS}'1,5'"),
    "no value": (' value="2"', "", f"4: link 'arm': a missing value {LEAST}"),
    "no mass": ('<mass value="2"/>', "", "3: link 'arm': its <inertial> has no … <mass>"),
    "no inertia": (INERTIA, "", "3: link 'arm': its <inertial> has no … <inertia>"),
    "NaN inertia": ('ixx="1"', 'ixx="nan"', "5: link 'arm': ixx='nan' of <inertia> must be a"),
    "half an inertia": (' izz="1"', "", "5: link 'arm': a missing izz of <inertia> must be"),
    "negative inertia": ('iyy="1"', 'iyy="-1"', "5: link 'arm': iyy='-1' of <inertia> must be a finite number, at"),
    "two inertials": ("</inertial>", f"</inertial>\n<inertial><mass value='1'/>{INERTIA}</inertial>", "6: link 'arm' has 2 <inertial>; only"),
    "crossed": ('lower="-1"', 'lower="2"', "7: joint 'j': lower 2 is above upper 1"),
    "one limit": ('lower="-1" ', "", "7: joint 'j' has one limit, 'upper'"),
    "NaN limit": ('upper="1"', 'upper="nan"', "7: joint 'j': upper='nan' of <limit> must be a"),
    "negative effort": ('effort="10"', 'effort="-10"', "7: joint 'j': effort='-10' of <limit> must be a finite number, at least 0"),
    "infinite velocity": ('velocity="3"', 'velocity="inf"', "7: joint 'j': velocity='inf' of <limit> must be a"),
    "no limit": (LIMIT, "", "6: joint 'j' is revolute and has no … <limit>"),
    "unknown type": ('"revolute"', '"hinge"', "6: joint 'j' is 'hinge', which is not supported"),
    "unknown child": ('child link="arm"', 'child link="amr"', "6: joint 'j': unknown child link 'amr' … did you mean 'arm'"),
    "no parent": ('<parent link="base"/>', "", "6: joint 'j' has no <parent link=\"…\"/>"),
    "follows nothing": ("</joint>", '<mimic joint="jj"/></joint>', "8: joint 'j' follows joint 'jj', which … did you mean 'j'"),
    "follows itself": ("</joint>", '<mimic joint="j"/></joint>', "8: joint 'j' follows 'j', which follows"),
    "link twice": ('<link name="base"/>', '<link name="arm"/>', "3: link 'arm' is defined twice"),
    "joint twice": ("</joint>", '</joint><joint name="j" type="fixed"><parent link="base"/><child link="arm"/></joint>', "8: joint 'j' is defined twice"),
    "two parents": ("</joint>", '</joint><joint name="k" type="fixed"><parent link="base"/><child link="arm"/></joint>', "8: link 'arm' is the child of joints"),
    "a circle": ("</joint>", '</joint><joint name="k" type="fixed"><parent link="arm"/><child link="base"/></joint>', '8: links base, arm form a closed chain'),
    "two roots": ('<link name="base"/>', '<link name="base"/><link name="alone"/>', '2: has 2 roots: base, alone; connect'),
    "no name": ('<link name="base"/>', "<link/>", "2: a <link> has no name"),
    "a letter for a number": ('axis xyz="0 1 0"', 'axis xyz="0 l 0"', "6: joint 'j': xyz='0 l 0' of <axis> must be 3 finite numbers"),
    "no direction": ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', "6: joint 'j': its axis is 0 0 0, which"),
    "NaN origin": ('xyz="0 0 1"', 'xyz="0 nan 1"', "3: link 'arm': xyz='0 nan 1' of … <origin>"),
    "another root": ("robot", "model", '1: is not a URDF: its root is <model> … <robot>'),
    "SDF": ("robot", "sdf", ' SDF is not supported; export the robot as URDF'),
    "floating": ('"revolute"', '"floating"', "6: joint 'j' is 'floating', which … without `fixed_base` floats"),
    "planar": ('"revolute"', '"planar"', "6: joint 'j' is 'planar', which is not supported; use"),
    "an odd shape": ("</inertial>", "</inertial><collision><geometry><torus/></geometry></collision>", "5: link 'arm': a <collision> is a <torus>, which"),
    "a size too few": ("</inertial>", '</inertial><visual><geometry><box size="1 2"/></geometry></visual>', "5: link 'arm': size='1 2' of <box> must be 3 finite numbers"),
    "no XML": ("</robot>", "", '8: is not XML: no element found: line'),
}  # fmt: skip


@pytest.mark.parametrize(("before", "after", "problem"), CASES.values(), ids=CASES)
def test_a_mistake_is_refused_with_its_line_and_name(tmp_path, before, after, problem):
    assert problems(tmp_path, ARM) == []
    assert before in ARM
    place, *words = problem.split(" … ")
    found = [row for row in problems(tmp_path, ARM.replace(before, after)) if row.startswith(place)]
    assert found
    assert [word for word in words if word not in found[0]] == []


def test_all_mistakes_are_listed_by_line(tmp_path):
    text = ARM.replace('value="2"', 'value="-1"').replace('effort="10"', 'effort="-1"')
    assert [line.split(":")[0] for line in problems(tmp_path, text)] == ["4", "7"]


@needs_robots
def test_a_xacro_is_checked_as_it_is_expanded(tmp_path):
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    text = ARM.replace('<robot name="r">', head).replace('value="2"', 'value="${1-2}"')
    assert problems(tmp_path, text, "r.xacro") == [f" link 'arm': value='-1' {LEAST}"]


HARMLESS = {
    "massless links that stand still": ('<link name="base"/>', f'<link name="base"><inertial><mass value="0"/>{INERTIA}</inertial></link>'),
    "a turning link that is massless": ('value="2"', 'value="0"'),
    "a link without an inertial that moves": (ARM[ARM.index("<inertial>"):ARM.index("</link>\n<joint")], ""),
    "rounding errors": (INERTIA, '<inertia ixx="0" iyy="0" izz="0" ixy="1e-20" ixz="0" iyz="0"/>'),
    "a thin rod": (INERTIA, '<inertia ixx="1" iyy="1.0000001" izz="1e-9" ixy="0" ixz="0" iyz="0"/>'),
    "no stops": ('lower="-1" upper="1" ', ""),
    "a continuous joint": (f'type="revolute"{ARM.split(chr(34) + "revolute" + chr(34))[1].split(LIMIT, maxsplit=1)[0]}{LIMIT}', f'type="continuous"{ARM.split(chr(34) + "revolute" + chr(34))[1].split(LIMIT, maxsplit=1)[0]}'),
    "a comment before the declaration": ("<robot", '<!-- by hand -->\n<?xml version="1.0"?>\n<robot'),
    "a zero byte behind the end": ("</robot>", "</robot>\n\0"),
}  # fmt: skip


@pytest.mark.parametrize(("before", "after"), HARMLESS.values(), ids=HARMLESS)
def test_what_engines_can_simulate_passes(tmp_path, before, after):
    assert before in ARM
    assert problems(tmp_path, ARM.replace(before, after)) == []


@pytest.mark.parametrize(
    "url",
    [
        *[
            pytest.param(f"package://example-robot-data/robots/{file}", marks=needs_robots)
            for file in (
                "baxter_description/urdf/baxter.urdf",
                "ur_description/urdf/ur5_robot.urdf",
                "panda_description/urdf/panda.urdf",
                "tiago_description/robots/tiago.urdf",
            )
        ],
        pytest.param("package://pybullet_data/husky/husky.urdf", marks=needs_pybullet),
        pytest.param("package://pybullet_data/r2d2.urdf", marks=needs_pybullet),
    ],
)
def test_well_known_robots_pass(url):
    assert read_robot(package_path(url))


@pytest.mark.parametrize(
    ("before", "after", "note"),
    [
        ('ixx="1"', 'ixx="3"', "link 'arm': no body can have the inertia (3, 1, 1) kg·m²: a principal moment"),
        ('ixy="0"', 'ixy="2"', "link 'arm': no body can have the inertia (1, 1, 1, 2, 0, 0)"),
        ('lower="-1" upper="1" ', "", "joint 'j' is revolute without lower and upper"),
        ('xyz="0 0 1"', 'xyz="$(optenv X 0) 0 1"', "link 'arm': xyz='$(optenv X 0) 0 1' of <origin> is not three finite numbers"),
    ],
)  # fmt: skip
def test_what_the_engine_computes_otherwise_is_a_warning(tmp_path, before, after, note):
    text = ARM.replace(before, after)
    assert problems(tmp_path, text) == []
    (found,) = read_robot(tmp_path / "r.urdf").warnings
    assert found.startswith(note)
    (tmp_path / "r.urdf").write_text(ARM)
    assert read_robot(tmp_path / "r.urdf").warnings == ()


def copy_of_two_link(folder, before, after, world=("", "")):
    source = Path(str(resources.files("stepbus_scenarios") / "two_link"))
    for path in source.iterdir():
        if path.is_file():
            (folder / path.name).write_bytes(path.read_bytes())
    urdf, world_file = folder / "two_link.urdf", folder / "world.yaml"
    text = urdf.read_text()
    assert re.search(before, text)
    urdf.write_text(re.sub(before, after, text, count=1))
    world_file.write_text(world_file.read_text().replace(*world))
    return folder / "scenario.yaml"


@pytest.mark.parametrize("command", ["validate", "run"])
def test_a_mistake_is_found_before_anything_starts(tmp_path, monkeypatch, capsys, command):
    scenario = copy_of_two_link(tmp_path, 'mass value="[^"]*"', 'mass value="-1"')
    monkeypatch.chdir(tmp_path)
    assert main([command, str(scenario)]) == 2
    lines = capsys.readouterr().err.split("\n")
    found = [line for line in lines if LEAST in line]
    # The plant's world and the controller's model name the same file.
    assert ["world" in line.split("two_link.urdf")[0] for line in found] == [True, False]
    assert all(
        re.search(r"two_link\.urdf:\d+: link '\w+': value='-1' of <mass>", line) for line in found
    )
    assert not (tmp_path / "runs").exists()


def test_a_missing_mesh_is_found_before_anything_starts(tmp_path, capsys):
    mesh = '<visual><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></visual>'
    scenario = copy_of_two_link(tmp_path, "</link>", f"{mesh}</link>")
    assert main(["validate", str(scenario)]) == 2
    sentence = "mesh 'package://nowhere/arm.stl' not found"
    assert re.search(rf"two_link\.urdf:\d+: link '\w+': {sentence}", capsys.readouterr().err)
