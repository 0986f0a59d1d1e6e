"""Pinocchio finds all shapes of a robot."""

import struct

import numpy as np
import pytest
import trimesh

from stepbus_kinematics import RobotModel, collision_geometry

INERTIAL = """<inertial><mass value="3"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def robot(folder, shapes):
    """Return a robot whose last link has these shapes."""
    links = "".join(f'<link name="{n}">{INERTIAL}{{}}</link>' for n in "abc").format("", "", shapes)
    joints = "".join(
        f'<joint name="{one}{other}" type="revolute"><parent link="{one}"/><child link="{other}"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for one, other in ("ab", "bc")
    )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{links}{joints}</robot>')
    return RobotModel(path)


def test_capsules_are_capsules(tmp_path, capfd):
    shape = '<geometry><capsule radius="0.1" length="0.4"/></geometry>'
    rows = f"<visual>{shape}</visual><collision>{shape}</collision>"
    named = f'<collision name="capsule">{shape}</collision>'
    tube = '<collision><geometry><cylinder radius="0.2" length="0.3"/></geometry></collision>'
    geometry = collision_geometry(robot(tmp_path, rows + named + tube))
    shapes = [item.geometry for item in geometry.geometryObjects]
    assert [type(shape).__name__ for shape in shapes] == ["Capsule", "Capsule", "Cylinder"]
    assert [shape.halfLength for shape in shapes] == pytest.approx([0.2, 0.2, 0.15])
    assert capfd.readouterr().err == ""


def test_a_mesh_is_beside_its_model(tmp_path):
    corners = np.eye(4, 3, dtype=np.float32)
    sides = [(0, 1, 2), (0, 3, 1), (1, 3, 2), (0, 2, 3)]
    rows = [struct.pack("<12fH", 0, 0, 0, *corners[list(t)].ravel(), 0) for t in sides]
    (tmp_path / "parts").mkdir()
    content = bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)
    (tmp_path / "parts/wedge.stl").write_bytes(content)
    mesh = '<collision><geometry><mesh filename="parts/wedge.stl"/></geometry></collision>'
    (item,) = collision_geometry(robot(tmp_path, mesh)).geometryObjects
    assert item.geometry.num_points == 4


def test_a_collada_mesh_has_the_unit_of_its_file(tmp_path):
    text = trimesh.creation.box((1000.0, 2000.0, 3000.0)).export(file_type="dae").decode()
    path = tmp_path / "part.dae"
    path.write_text(text.replace("<up_axis>", '<unit name="mm" meter="0.001"/><up_axis>'))
    mesh = '<collision><geometry><mesh filename="part.dae" scale="1 1 2"/></geometry></collision>'
    (item,) = collision_geometry(robot(tmp_path, mesh)).geometryObjects
    assert np.ptp(item.geometry.points(), axis=0) == pytest.approx((1.0, 2.0, 6.0))
