"""URDF and xacro."""

import re
import sys
from pathlib import Path

import pytest
from support.runs.scenario import changed, load_text, write
from support.tools import needs_robots

from stepbus_models import read_robot
from stepbus_schemas import WiringError

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def xacro(folder: Path, content: str, name: str = "r.urdf.xacro") -> Path:
    return write(folder, f"{HEAD}{content}</robot>", name)


def refusal(path: Path) -> str:
    with pytest.raises(WiringError) as caught:
        read_robot(path)
    return str(caught.value)


def text_of(path):
    """Return the URDF that a file is expanded to."""
    return read_robot(path).text


@needs_robots
def test_a_xacro_is_expanded(tmp_path):
    macro = '<xacro:macro name="l" params="n"><link name="${n}_${2*3}"/></xacro:macro>'
    assert '<link name="arm_6"/>' in text_of(xacro(tmp_path, f'{macro}<xacro:l n="arm"/>'))


@needs_robots
def test_included_files_are_found_beside_their_own_file_and_in_packages(tmp_path):
    url = "package://example-robot-data/robots/ur_description/urdf/ur5_robot.urdf"
    xacro(tmp_path, f'<xacro:include filename="{url}"/>', "parts/arm.xacro")
    xacro(tmp_path, '<xacro:include filename="arm.xacro"/>', "parts/all.xacro")
    text = text_of(xacro(tmp_path, '<xacro:include filename="parts/all.xacro"/>'))
    assert 'name="shoulder_pan_joint"' in text


@needs_robots
@pytest.mark.parametrize(
    ("include", "names"),
    [
        ('<xacro:include filename="gone.xacro" optional="true"/>', []),
        ('<xacro:include filename="parts/*.xacro"/>', ["a", "b"]),
        ('<xacro:include filename="$(find my_arm)/urdf/c.xacro"/>', ["c", "d"]),
        ("<xacro:include filename=\"${'parts'}/a.xacro\"/>", ["a"]),
    ],
)
def test_xacro_decides_what_is_included(tmp_path, include, names):
    for name in ("parts/a", "parts/b", "my_arm/urdf/d"):
        xacro(tmp_path, f'<material name="{name[-1]}"/>', f"{name}.xacro")
    inner = '<material name="c"/><xacro:include filename="$(find my_arm)/urdf/d.xacro"/>'
    xacro(tmp_path, inner, "my_arm/urdf/c.xacro")
    text = text_of(xacro(tmp_path, f'<link name="base"/>{include}'))
    assert re.findall(r'<material name="(\w)"', text) == names


@needs_robots
def test_a_package_that_xacro_looks_for_in_vain_is_named(tmp_path):
    told = refusal(xacro(tmp_path, '<xacro:include filename="$(find no_arm)/a.xacro"/>'))
    assert "and no folder 'no_arm' is in or above" in told


@needs_robots
def test_xacro_in_a_file_called_urdf_is_expanded(tmp_path):
    content = '<xacro:property name="ns" value="left"/><link name="${ns}_base"/>'
    assert '<link name="left_base"/>' in text_of(xacro(tmp_path, content, "r.urdf"))
    content = '<link name="$(arg side)"/>'
    xacro(tmp_path, '<xacro:arg name="side" default="left"/>', "my_arm/side.xacro")
    include = '<xacro:include filename="$(find my_arm)/side.xacro"/>'
    assert '<link name="left"/>' in text_of(xacro(tmp_path, include + content, "r.urdf"))


@needs_robots
@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('<link name="${unknown}"/>', "cannot expand xacro: .*unknown"),
        ('<xacro:include filename="gone.xacro"/>', "No such file or directory: .*gone.xacro"),
        ('<xacro:include filename="package://no-such/x"/>', "package 'no-such' is not installed"),
        (
            '<xacro:include filename="r.urdf.xacro"/>',
            r"xacro: \S*/r.urdf.xacro includes itself, or",
        ),
        ("<link", "is not XML"),
        ("<xacro:property/>", "cannot expand xacro: .*missing attribute 'name'"),
        (
            '<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>',
            "or a macro calls itself$",
        ),
        ('<link name="${a b}"/>', "invalid syntax .* when evaluating expression 'a b'$"),
    ],
)
def test_what_cannot_be_expanded_is_refused_with_its_file(tmp_path, content, told):
    path = xacro(tmp_path, content)
    message = refusal(path)
    assert str(tmp_path) in message
    with pytest.raises(WiringError, match=told):
        text_of(path)


@needs_robots
def test_a_mistake_leaves_nothing_behind_for_the_next_file(tmp_path):
    refusal(xacro(tmp_path, '<link name="${unknown}"/>'))
    assert '<link name="x"/>' in text_of(xacro(tmp_path, '<link name="x"/>'))


def test_without_the_package_xacro_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    assert "xacro needs xacro" in refusal(xacro(tmp_path, ""))


@pytest.mark.parametrize("name", ["r.urdf", pytest.param("r.xacro", marks=needs_robots)])
def test_a_file_that_is_not_there_is_refused(tmp_path, name):
    assert "No such file" in refusal(tmp_path / name)


def test_included_files_become_part_of_a_recording(tmp_path):
    xacro(tmp_path, '<xacro:include filename="arm.xacro"/>', "parts/all.xacro")
    xacro(tmp_path, "", "parts/arm.xacro")
    found = load_text(tmp_path, changed("law: pd", "model: parts/all.xacro")).files
    assert list(found) == ["parts/all.xacro", "parts/arm.xacro"]
