"""Both engines and the controller's model compute with the same robot, however a URDF is written."""

import math
import re

import numpy as np
import pytest
from support.services.mechanics import (
    FLOOR,
    ROOT,
    STEP,
    G,
    Row,
    advance,
    command,
    fixed,
    joint,
    link,
    make,
    robot,
    state,
)
from support.tools import needs_opengl

from stepbus_kinematics import RobotModel
from stepbus_plant.engine import Light
from stepbus_plant.geometry import projection_matrix, view_matrix
from stepbus_schemas import WiringError

LEVER = 0.3
MOMENT = 0.02


def arm(axis, kind="continuous", limit="", moments=(MOMENT,) * 3):
    """Return a link of 1 kg whose centre is 0.3 m off its joint."""
    rod = link("rod", 1.0, moments, centre=f"{LEVER} 0 0")
    return robot(ROOT, rod, joint("hinge", kind, "rod", axis, limit))


def start(folder, engine, urdf, world=""):
    return make(folder, engine, {"arm": fixed(urdf)}, world)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        *[('xyz="0 1 0"', f'xyz="{axis}"') for axis in ("0 2 0", "0 0.99 0", "0 1e-3 0")],
        ('"root"', '"world"'),
        ("</joint>", '<dynamics damping="9" friction="9"/></joint>'),
    ],
)
def test_what_changes_nothing_changes_nothing(tmp_path, engine, before, after):
    """Lengths of axes, a link that is called world, and friction, which the world file has."""
    urdf = arm("0 1 0")
    assert before in urdf
    plant = advance(start(tmp_path, engine, urdf.replace(before, after)), 1)
    acceleration = state(plant, "hinge")[1] / STEP
    assert acceleration == pytest.approx(G * LEVER / (MOMENT + LEVER**2), rel=1e-6)


NARROW = 'lower="-0.1" upper="0.1" effort="99" velocity="99"'


@pytest.mark.parametrize(("kind", "limit"), [("continuous", NARROW), ("revolute", "")])
def test_a_joint_without_stops_has_none_anywhere(tmp_path, engine, kind, limit):
    """A revolute one is named; a continuous one has none though its limit gives some."""
    plant = start(tmp_path, engine, arm("0 0 1", kind, limit))
    command(plant, "torque", 1.0)
    advance(plant, 1000)
    assert state(plant, "hinge")[0] == pytest.approx(0.5 / (MOMENT + LEVER**2), rel=2e-3)
    assert RobotModel(tmp_path / "arm.urdf", ["hinge"]).upper[0] == math.inf
    named = ["'hinge' is revolute without lower" in text for _, text in plant.physics.notes]
    assert named == [True] * (kind == "revolute")


def test_a_prismatic_joint_without_stops_falls_freely_and_is_named(tmp_path, engine):
    plant = start(tmp_path, engine, arm("0 0 -1", "prismatic", 'effort="9" velocity="99"'))
    advance(plant, 100)
    assert state(plant, "hinge")[1] == pytest.approx(G * 0.1, rel=1e-6)
    (note,) = [text for _, text in plant.physics.notes]
    assert "'hinge' is prismatic without lower" in note


IMPOSSIBLE = {
    # The trace is kept: a third of it about every axis, as MuJoCo's balanceinertia has it.
    "a moment above the others' sum": ((1.0, 1.0, 3.0), "0", 5 / 3),
    "a product above the moments": ((1.0, 1.0, 1.0), "2", 1.0),
    # A rounded plate, whose moments about its edges are 1/12: 1/12 + 1/12 = 1/6.
    "a rounded plate": ((0.0833333, 0.0833333, 0.166667), "0", 1 / 6),
}


@pytest.mark.parametrize(("moments", "product", "right"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_an_impossible_inertia_is_repaired_alike(tmp_path, engine, moments, product, right):
    root, rod = arm("0 0 1", moments=moments).split('<link name="rod">')
    rod = rod.replace('ixy="0"', f'ixy="{product}"')
    urdf = f'{root}<link name="rod">{rod}'
    plant = start(tmp_path, engine, urdf, "gravity: [0, 0, 0]")
    command(plant, "torque", 1.0)
    advance(plant, 1)
    whole = right + LEVER**2
    assert state(plant, "hinge")[1] / STEP == pytest.approx(1.0 / whole, rel=1e-5)
    model = RobotModel(tmp_path / "arm.urdf", ["hinge"])
    assert model.inverse_dynamics(*np.array([[0.0], [0.0], [1.0]]))[0] == pytest.approx(
        whole, rel=1e-5
    )
    (note,) = [text for _, text in plant.physics.notes]
    assert "'rod': no body can have the inertia" in note


CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]) - 0.5
SIDES = [(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4), (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5)]  # fmt: skip


def text_stl(edge):
    """Return a cube of an edge [m] as an STL written as text."""
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {' '.join(map(str, corner))}\n" for corner in edge * CORNERS[list(side)])
        + "endloop\nendfacet\n"
        for side in SIDES
    )
    return f"solid cube\n{facets}endsolid cube\n"


def test_a_mesh_in_an_stl_written_as_text_is_solid(tmp_path, engine):
    (tmp_path / "cube.stl").write_text(text_stl(0.6))
    cube = robot(link("cube", 1.0, (0.06,) * 3, '<mesh filename="cube.stl"/>'))
    bodies = {"ground": fixed(FLOOR), "cube": Row(cube, "position: [0, 0, 0.31]")}
    plant = advance(make(tmp_path, engine, bodies), 1000)
    # PyBullet keeps hulls a margin of 1 mm apart from what they stand on.
    assert plant.physics.engine.centre(1)[0][2] == pytest.approx(0.3, abs=2e-3)
    (distance,) = plant.physics.engine.cast(
        np.array([[0.0, 0.0, 2.0]]), np.array([[0.0, 0.0, 0.0]])
    )
    assert distance == pytest.approx((2.0 - 0.6) / 2.0, abs=2e-3)


def test_a_collision_shape_that_an_engine_drops_is_refused_by_name(tmp_path, engine):
    (tmp_path / "flat.stl").write_text("solid flat\nendsolid flat\n")
    thing = robot(link("thing", 1.0, (1.0,) * 3, '<mesh filename="flat.stl"/>'))
    with pytest.raises(WiringError, match=r"thing\.urdf: link 'thing' .*flat\.stl|flat\.stl"):
        make(tmp_path, engine, {"thing": fixed(thing)})


WALL = '<box size="0.2 2 2"/>'
FLAT = Light(direction=(0, 0, 1), distance=1, ambient=1, diffuse=0, specular=0, has_shadow=False)


def look(plant):
    needs_opengl(plant.physics.engine.name)
    view = view_matrix((0.0, 0.0, 0.0), 3.0, math.radians(90), 0.0)
    projection = projection_matrix(1.0, 1.0, 0.1, 10.0)
    return plant.physics.engine.image((8, 8), view, projection, FLAT)


def test_a_plant_that_ends_takes_no_image_of_another_one_along(tmp_path, engine):
    (tmp_path / "first").mkdir()
    wall = {"wall": fixed(robot(link("wall", 1.0, (1.0,) * 3, WALL)))}
    first, second = (make(folder, engine, wall) for folder in (tmp_path / "first", tmp_path))
    look(first)
    image, _ = look(second)
    # The context of the second one is the current one.
    first.physics.close()
    # What is not drawn anew shows what was in memory.
    junk = [np.full_like(image, number) for number in range(100)]
    del junk
    assert np.array_equal(look(second)[0], image)


# --- what readers of a URDF do differently by themselves -----------------------------------


def test_links_behind_fixed_joints_keep_their_names_masses_and_places(tmp_path, engine):
    tool = link("tool", 0.5, (MOMENT,) * 3)
    mount = joint("mount", "fixed", "tool", parent="rod", origin='xyz="0.7 0 0"')
    urdf = arm("0 1 0").replace("</robot>", f"{tool}{mount}</robot>")
    physics = start(tmp_path, engine, urdf).physics
    assert list(physics.links) == ["root", "rod", "tool"]
    assert physics.fixed == {"mount"}
    assert physics.engine.mass(physics.links["tool"]) == 0.5
    assert physics.engine.frame(physics.links["tool"])[0] == pytest.approx((0.7, 0, 0))


def test_a_turned_inertia_with_products_is_that_of_the_file(tmp_path, engine):
    moments = '<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0.03" ixz="-0.01" iyz="0.02"/>'
    turned = f'<origin xyz="{LEVER} 0 0" rpy="0.3 -0.4 0.5"/><mass value="1.0"/>{moments}'
    urdf = re.sub(
        r'(<link name="rod"><inertial>).*?(</inertial>)', rf"\g<1>{turned}\g<2>", arm("0 0 1")
    )
    plant = start(tmp_path, engine, urdf, "gravity: [0, 0, 0]")
    command(plant, "torque", 1.0)
    model = RobotModel(tmp_path / "arm.urdf", ["hinge"])
    whole = model.inverse_dynamics(*np.array([[0.0], [0.0], [1.0]]))[0]
    assert state(advance(plant, 1), "hinge")[1] / STEP == pytest.approx(1.0 / whole, rel=1e-6)


def test_meshes_of_the_same_name_in_two_folders_are_two(tmp_path, engine):
    for folder, edge in (("a", 0.2), ("b", 0.6)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "part.stl").write_text(text_stl(edge))
    for name, (folder, top) in {"small": ("a", 0.1), "large": ("b", 0.3)}.items():
        urdf = robot(link(name, 1.0, (1.0,) * 3, f'<mesh filename="{folder}/part.stl"/>'))
        physics = make(tmp_path, engine, {name: fixed(urdf)}).physics
        (hit,) = physics.engine.cast(np.array([[0, 0, 1.0]]), np.array([[0, 0, -1.0]]))
        assert 1.0 - 2.0 * hit == pytest.approx(top, abs=2e-3)


def test_limits_of_effort_and_velocity_are_those_of_the_file(tmp_path, engine):
    limit = 'lower="-1" upper="2" effort="7" velocity="3"'
    hinge = start(tmp_path, engine, arm("0 1 0", "revolute", limit)).physics.joints["hinge"]
    assert (hinge.lower, hinge.upper, hinge.effort, hinge.max_velocity) == (-1.0, 2.0, 7.0, 3.0)
