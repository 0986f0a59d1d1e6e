"""What touches, beside the closed form. Tolerances were written before any engine was measured."""

import math

import numpy as np
import pytest
from support.services.mechanics import (
    FLOOR,
    STEP,
    G,
    Row,
    acceleration,
    advance,
    ball,
    between,
    box,
    centre,
    fixed,
    make,
    number,
    rough,
    slope,
    velocity,
)

from stepbus_plant.engine import BASE
from stepbus_plant.geometry import rotation

FLAT = (0.2, 0.2, 0.05)
SOFT_S = 2 * STEP
"""Time constant of MuJoCo's contacts: two substeps [s]."""


def assert_lies(plant, engine):
    """Assert that a box lies on a slope; in MuJoCo it rattles, which lifts its edges by 1 mm."""
    ground, thing = (rotation(plant.physics.engine.frame((n, BASE))[1]) for n in (0, 1))
    assert np.dot(ground[:, 2], thing[:, 2]) == pytest.approx(1.0, abs=(1e-3 / FLAT[0]) ** 2)
    if engine == "pybullet":
        assert plant.physics.engine.motion((1, BASE)).spin == pytest.approx((0, 0, 0), abs=0.05)


def on_slope(tmp_path, engine, tangent):
    """Return a box on a slope, with a friction of 0.5, and the direction down."""
    ground, down, thing = slope(engine, math.atan(tangent), 0.5, FLAT[2] / 2)
    bodies = {"ground": fixed(FLOOR, ground), "thing": Row(box("thing", 1.0, *FLAT), thing)}
    return make(tmp_path, engine, bodies), down


def test_a_box_holds_on_a_slope_below_the_angle_of_friction(tmp_path, engine):
    plant, down = on_slope(tmp_path, engine, 0.45)
    before = centre(advance(plant, 200), "thing") @ down
    # What stands on a shelf for a minute may creep by 6 cm, and no more.
    assert centre(advance(plant, 1000), "thing") @ down == pytest.approx(before, abs=1e-3)


def test_a_box_slides_on_a_slope_above_the_angle_of_friction(tmp_path, engine):
    plant, down = on_slope(tmp_path, engine, 0.7)
    angle = math.atan(0.7)
    expected = G * (math.sin(angle) - 0.5 * math.cos(angle))
    assert acceleration(plant, "thing", down, 200, 700) == pytest.approx(expected, rel=0.03)
    assert_lies(plant, engine)


@pytest.mark.parametrize("share", [2 / 5, 1 / 2])
def test_a_ball_rolls_down_a_slope_without_slipping(tmp_path, engine, share):
    """0.4: a solid ball, 5/7 g sin; 0.5: the moment of a disc, 2/3 g sin."""
    angle, radius = math.radians(20), 0.1
    ground, down, thing = slope(engine, angle, 1.0, radius)
    thing = thing.replace("friction: {lateral: 1.0}", "friction: {lateral: 1.0, rolling: 0}")
    rolling = Row(ball("ball", 1.0, radius, share), thing)
    plant = make(tmp_path, engine, {"ground": fixed(FLOOR, ground), "ball": rolling})
    expected = G * math.sin(angle) / (1 + share)
    assert acceleration(plant, "ball", down, 100, 600) == pytest.approx(expected, rel=0.02)
    motion = plant.physics.engine.motion((number(plant, "ball"), BASE))
    assert motion.spin[1] * radius == pytest.approx(np.dot(motion.velocity, down), rel=0.01)


def test_a_box_that_falls_stays_on_the_floor(tmp_path, engine):
    falling = Row(box("crate", 1.0, 0.1, 0.1, 0.1), "position: [0, 0, 0.3]")
    plant = make(tmp_path, engine, {"ground": fixed(FLOOR), "crate": falling})
    heights = [centre(advance(plant, 1), "crate")[2] for _ in range(1200)]
    landed = next(n for n, height in enumerate(heights) if height < 0.052)
    # It falls through 0.25 m: a restitution of 0.15 would throw it up by 5.6 mm.
    assert max(heights[landed:]) < 0.05 + 0.15**2 * 0.25
    assert min(heights) > 0.05 - 0.01
    assert heights[-1] == pytest.approx(0.05, abs=2e-3)
    assert np.abs(velocity(plant, "crate")).max() < 1e-3


def test_two_boxes_that_collide_keep_their_momentum_and_go_on_together(tmp_path, engine):
    bodies = {
        "one": Row(box("one", 2.0, 0.2, 0.2, 0.2)),
        "two": Row(box("two", 1.0, 0.2, 0.2, 0.2), "position: [0.3, 0, 0]"),
    }
    plant = make(tmp_path, engine, bodies, "gravity: [0, 0, 0]")
    frame = plant.physics.engine.frame((0, BASE))
    plant.physics.engine.put(0, frame, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    advance(plant, 300)
    one, two = velocity(plant, "one"), velocity(plant, "two")
    np.testing.assert_allclose(2 * one + two, (2.0, 0.0, 0.0), atol=1e-6)
    assert 0.0 <= two[0] - one[0] < 0.15


def test_a_stack_at_rest_presses_with_its_weight(tmp_path, engine):
    edge, names = 0.1, ["low", "middle", "top"]
    bodies = {"ground": fixed(FLOOR)} | {
        name: Row(box(name, 1.0, edge, edge, edge), f"position: [0, 0, {edge * (n + 0.5)}]")
        for n, name in enumerate(names)
    }
    plant = advance(make(tmp_path, engine, bodies), 1000)
    forces = dict.fromkeys(names, 0.0)
    for _ in range(100):
        advance(plant, 1)
        for below, name in zip(["ground", *names], names, strict=False):
            forces[name] += sum(contact.force for contact in between(plant, name, below)) / 100
    assert [forces[name] / G for name in names] == pytest.approx([3, 2, 1], rel=0.02)
    for n, (below, name) in enumerate(zip(["ground", *names], names, strict=False)):
        seen, seen_from_below = between(plant, name, below), between(plant, below, name)
        assert seen
        assert len(seen) == len(seen_from_below)
        # From the other one to the first: up, and down as the lower one has it.
        assert [contact.normal[2] for contact in seen] == pytest.approx([1] * len(seen), abs=1e-3)
        assert [c.normal[2] for c in seen_from_below] == pytest.approx([-1] * len(seen), abs=1e-3)
        for contact in seen:
            assert contact.force >= 0.0
            assert contact.distance == pytest.approx(0.0, abs=2e-3)
            assert contact.on_one[2] == pytest.approx(n * edge, abs=4e-3)
            gap = np.dot(np.subtract(contact.on_one, contact.on_other), contact.normal)
            assert gap == pytest.approx(contact.distance, abs=1e-4)


def test_contacts_that_press_have_a_force(tmp_path, engine):
    standing = Row(box("crate", 1.0, 0.1, 0.1, 0.1), "position: [0, 0, 0.05]")
    plant = make(tmp_path, engine, {"ground": fixed(FLOOR), "crate": standing})
    advance(plant, 500)
    pressed = plant.physics.engine.contacts(1, are_pressed=True)
    assert pressed
    assert all(contact.force > 0.0 for contact in pressed)
    assert plant.physics.engine.contacts(1, BASE, are_pressed=True) == pressed


def test_the_nearest_points_of_two_boxes(tmp_path, engine):
    bodies = {
        "one": fixed(box("one", 1.0, 0.2, 0.2, 0.2)),
        "two": fixed(box("two", 1.0, 0.2, 0.2, 0.2), "position: [0.25, 0, 0]"),
    }
    plant = make(tmp_path, engine, bodies)
    plant.physics.engine.update_shapes()
    near = plant.physics.engine.closest((0, BASE), 0.1)
    assert near
    nearest = min(near, key=lambda contact: contact.distance)
    assert nearest.distance == pytest.approx(0.05, abs=1e-4)
    assert nearest.normal == pytest.approx((-1, 0, 0), abs=1e-3)
    assert (nearest.one, nearest.other) == ((0, BASE), (1, BASE))
    assert (nearest.on_one[0], nearest.on_other[0]) == pytest.approx((0.1, 0.15), abs=1e-4)
    assert plant.physics.engine.closest((0, BASE), 0.04) == []
    low, high = plant.physics.engine.box((1, BASE))
    assert (*low, *high) == pytest.approx((0.15, -0.1, -0.1, 0.35, 0.1, 0.1), abs=0.025)


def test_friction_is_the_same_in_every_direction(tmp_path, engine):
    angle = math.atan(0.7)
    ground, down, thing = slope(engine, angle, 0.5, FLAT[2] / 2)
    plant = make(
        tmp_path,
        engine,
        {"ground": fixed(FLOOR, ground), "thing": Row(box("thing", 1.0, *FLAT), thing)},
    )
    frame, turn = plant.physics.engine.frame((1, BASE)), 0.6
    yaw = (0.0, 0.0, math.sin(turn / 2), math.cos(turn / 2))
    plant.physics.engine.put(1, plant.physics.engine.geometry.compose(frame, ((0, 0, 0), yaw)))
    expected = G * (math.sin(angle) - 0.5 * math.cos(angle))
    assert acceleration(plant, "thing", down, 200, 700) == pytest.approx(expected, rel=0.03)
    assert_lies(plant, engine)


def on_floor(tmp_path, engine, friction):
    """Return a ball of 1 kg and 0.1 m on a floor of friction 1."""
    keys = f"position: [0, 0, 0.1], friction: {{lateral: 1, {friction}}}"
    ground = fixed(FLOOR, "friction: {lateral: 1}")
    return make(tmp_path, engine, {"ground": ground, "ball": Row(ball("ball", 1.0, 0.1), keys)})


def test_rolling_friction_slows_a_ball(tmp_path, engine):
    plant = on_floor(tmp_path, engine, "rolling: 0.01")
    plant.physics.engine.put(1, ((0, 0, 0.1), (0, 0, 0, 1)), (1.0, 0.0, 0.0), (0.0, 10.0, 0.0))
    advance(plant, 500)
    # Its torque is 0.01 m · m g; a ball's moment adds 0.4 to its mass.
    expected = 1.0 - 0.01 * G / 0.1 / 1.4 * 0.5
    assert velocity(plant, "ball")[0] == pytest.approx(expected, rel=0.03)


def test_spinning_friction_slows_a_ball_that_turns_on_the_spot(tmp_path, engine):
    plant = on_floor(tmp_path, engine, "spinning: 0.01")
    plant.physics.engine.put(1, ((0, 0, 0.1), (0, 0, 0, 1)), (0.0, 0.0, 0.0), (0.0, 0.0, 30.0))
    advance(plant, 500)
    spin = plant.physics.engine.motion((1, BASE)).spin
    expected = 30 - 0.01 * G / (0.4 * 0.1**2) * 0.05 * 10
    assert spin[2] == pytest.approx(max(expected, 0.0), abs=0.5)


def test_a_fixed_body_that_moves_pushes_what_is_before_it(tmp_path, engine):
    """A wall goes 0.3 m in 1 s; the crate is pushed ahead of it, and slides on by v² / 2 μ g.

    MuJoCo's contacts do not know how fast a wall comes: the crate is pushed by what gives way, which
    is 2 v times their time constant, and comes out of it afterwards.
    """
    crate = "position: [0.1, 0, 0.05], friction: {lateral: 0.5}"
    bodies = {
        "ground": fixed(FLOOR, rough(engine)),
        "crate": Row(box("crate", 1.0, 0.1, 0.1, 0.1), crate),
        "wall": fixed(box("wall", 1.0, 0.1, 0.4, 0.4), "position: [0, 0, 0.21]"),
    }
    script = [{"at": "100ms", "body": "wall", "to": [0.3, 0.0, 0.21], "over": "1s"}]
    plant = advance(make(tmp_path, engine, bodies, script=script), 600)
    soft = 0.0 if engine == "pybullet" else 2 * 0.3 * SOFT_S
    assert velocity(plant, "crate")[0] == pytest.approx(0.3, rel=0.15 if soft else 0.03)
    # In MuJoCo, what is placed has no velocity.
    own = 0.3 if engine == "pybullet" else 0.0
    assert plant.physics.engine.motion((2, BASE)).velocity == pytest.approx((own, 0, 0), abs=1e-6)
    slides = 0.3**2 / (2 * 0.5 * G)
    assert centre(advance(plant, 1000), "crate")[0] == pytest.approx(0.4 + slides, abs=5e-3 + soft)


def test_what_stands_on_a_plate_that_sinks_goes_with_it(tmp_path, engine):
    bodies = {
        "plate": fixed(box("plate", 1.0, 1, 1, 0.1)),
        "crate": Row(box("crate", 1.0, 0.1, 0.1, 0.1), "position: [0, 0, 0.1]"),
    }
    script = [{"at": "100ms", "body": "plate", "to": [0.0, 0.0, -0.06], "over": "300ms"}]
    plant = advance(make(tmp_path, engine, bodies, script=script), 250)
    # On average: in MuJoCo it falls after the plate, again and again.
    before = centre(plant, "crate")[2]
    fallen = centre(advance(plant, 100), "crate")[2] - before
    assert fallen / 0.1 == pytest.approx(-0.2, rel=0.03 if engine == "pybullet" else 0.1)
    assert centre(advance(plant, 500), "crate")[2] == pytest.approx(0.04, abs=2e-3)


def test_bodies_that_overlap_are_nearer_than_nothing(tmp_path, engine):
    bodies = {
        "one": fixed(box("one", 1.0, 0.2, 0.2, 0.2)),
        "two": fixed(box("two", 1.0, 0.2, 0.2, 0.2), "position: [0.19, 0, 0]"),
        "far": fixed(box("far", 1.0, 0.2, 0.2, 0.2), "position: [3, 0, 0]"),
    }
    engine_ = make(tmp_path, engine, bodies).physics.engine
    engine_.update_shapes()
    near = engine_.closest((0, BASE), 0.1)
    nearest = min(near, key=lambda contact: contact.distance)
    assert {contact.other for contact in near} == {(1, BASE)}
    assert nearest.distance == pytest.approx(-0.01, abs=1e-3)
    assert nearest.normal == pytest.approx((-1, 0, 0), abs=1e-2)
