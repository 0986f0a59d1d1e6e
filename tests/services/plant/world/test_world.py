import pytest
from support.paths import DOCS
from support.services.plant import body, make_plant, write_world

from stepbus_plant import Params, load_world
from stepbus_plant.world import (
    BaseSettings,
    Body,
    ContactSensorSettings,
    Friction,
    GripperSettings,
    JointSettings,
    WorldFile,
)
from stepbus_schemas import WiringError

FIVE_MISTAKES = """gravity: [0, 0]
physics_step: 5 parsecs
solver: 50
bodies:
  arm:
    urdf: nowhere.urdf
    joint_defaults: {mode: magic, damping: -1}
    joints:
      joint1: {effort: lots}
  17: {urdf: two_link.urdf}
  ghost: {fixed_base: maybe}
"""


def mistakes(folder, text):
    with pytest.raises(WiringError) as caught:
        load_world(write_world(folder, text))
    lines = [line.removeprefix(f"{folder}/") for line in str(caught.value).splitlines()]
    return [": ".join(line.split(": ")[:2]) for line in lines]


def refusal(folder, *bodies, **more):
    with pytest.raises(WiringError) as caught:
        make_plant(folder, *bodies, **more)
    return str(caught.value).replace(f"{folder}/", "").splitlines()


def test_all_mistakes_of_a_world_are_listed_with_their_lines(tmp_path):
    assert mistakes(tmp_path, FIVE_MISTAKES) == [
        "world.yaml:1: gravity",
        "world.yaml:2: physics_step",
        "world.yaml:3: solver",
        "world.yaml:6: bodies.arm.urdf",
        "world.yaml:7: bodies.arm.joint_defaults.mode",
        "world.yaml:7: bodies.arm.joint_defaults.damping",
        "world.yaml:9: bodies.arm.joints.joint1.effort",
        "world.yaml:10: bodies",
        "world.yaml:11: bodies.ghost",
        "world.yaml:11: bodies.ghost.fixed_base",
    ]


def test_all_mistakes_that_the_urdfs_show_are_listed_with_their_lines(tmp_path):
    lines = refusal(
        tmp_path,
        body("arm", "two_link", joints="{jont1: {effort: 3}, joint2: {position: 9}}"),
        body("free", "free_wheel", "{upper: 1}"),
        body("crossed", "wheel", "{lower: 3}"),
    )
    words = [
        "'jont1'",
        "[-6.2832, 6.2832]",
        "no limits",
        "lower 3.0 is above upper 1.0",
    ]
    assert [line.split(":")[1] for line in lines] == ["3", "3", "4", "5"]
    assert [word in line for word, line in zip(words, lines, strict=True)] == [True] * 4


def test_a_model_that_cannot_be_read_is_refused_with_both_lines(tmp_path):
    (tmp_path / "broken.urdf").write_text("<robot>\n<link")
    (line,) = refusal(tmp_path, body("junk", "broken"))
    assert line.startswith("world.yaml:3: bodies.junk.urdf: ")
    assert "broken.urdf:2: is not XML" in line


@pytest.mark.parametrize(
    ("text", "mistake"),
    [
        ("", "world.yaml: is empty"),
        ("[1, 2]", "world.yaml: is not a map; a world needs at least 'bodies'"),
        ("bodies: {}", "world.yaml:1: bodies"),
        ("gravity: [0, 0, 0]", "world.yaml: the key 'bodies' is missing"),
        ("bodies: {a: {urdf: two_link.urdf}}\nbodies: 2", "world.yaml:2: bodies"),
        ("bodies: {a: {urdf: two_link.urdf}\n", "world.yaml:2"),
        ("bodies: {a: {urdf: !!python/object:os.system ls}}", "world.yaml:1: bodies.a.urdf"),
        ("bodies: &a {b: *a}", "world.yaml: is nested too deeply"),
        (
            "bodies: {a: {urdf: two_link.urdf}}\nsubsteps: 2\nphysics_step: 1ms",
            "world.yaml:2: substeps",
        ),
        ("bodies: {a: {urdf: two_link.urdf}}\nsubsteps: 0", "world.yaml:2: substeps"),
        ("bodies: {a: {urdf: two_link.urdf}}\ngravity: [0, 0, .nan]", "world.yaml:2: gravity"),
        ("bodies: {a: {urdf: 'package://no_such_package/x.urdf'}}", "world.yaml:1: bodies.a.urdf"),
    ],
)
def test_a_file_that_is_no_world_is_refused(tmp_path, text, mistake):
    found = mistakes(tmp_path, text)
    assert len(found) == 1
    assert found[0].startswith(mistake)


def test_a_joints_own_settings_go_over_the_defaults_of_its_body(tmp_path):
    arm = body("arm", "two_link", "{effort: 7, damping: 1}", "{joint2: {effort: 3}}")
    assert make_plant(tmp_path, arm).joints.description.limits["effort"] == [7.0, 3.0]


def test_an_arm_in_free_fall_does_not_bend_and_a_fixed_one_does(tmp_path):
    fixed, free = body("arm", "two_link"), "  arm: {urdf: two_link.urdf}\n"
    bends = []
    for arm in (fixed, free):
        plant = make_plant(tmp_path, arm)
        for _ in range(20):
            plant.advance()
        bends.append(plant.sense().position[0])
    assert bends[0] > 0.05
    assert bends[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "rows",
    [
        *(WorldFile, Body, JointSettings, Friction, Params),
        *(BaseSettings, ContactSensorSettings, GripperSettings),
    ],
)
def test_every_key_is_documented(rows):
    text = (DOCS / "reference/world.md").read_text(encoding="utf-8")
    assert [key for key in rows.__struct_encode_fields__ if f"`{key}`" not in text] == []
