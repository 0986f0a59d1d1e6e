"""Each engine beside the closed form. Tolerances were written before any engine was measured."""

import math

import numpy as np
import pytest
from support.services.mechanics import (
    DISC,
    DISC_MOMENT,
    FLOOR,
    MS,
    ROD,
    ROD_MOMENT,
    ROD_TORQUE,
    ROOT,
    STEP,
    G,
    Row,
    acceleration,
    advance,
    ball,
    between,
    box,
    centre,
    command,
    fixed,
    joint,
    link,
    make,
    number,
    robot,
    sensed,
    slope,
    state,
    velocity,
)

from stepbus_plant.engine import BASE
from stepbus_plant.engines import ENGINES, is_here
from stepbus_plant.geometry import rotation
from stepbus_schemas import JointCommand


@pytest.fixture(params=ENGINES)
def engine(request):
    if not is_here(request.param):
        pytest.skip(f"{request.param} is not installed")
    return request.param


# --- free motion --------------------------------------------------------------------------


def test_free_fall_is_that_of_semi_implicit_euler(tmp_path, engine):
    plant = make(tmp_path, engine, {"stone": Row(box("stone", 2.0, 0.1, 0.1, 0.1))})
    n = 1000
    advance(plant, n)
    # v is advanced first: the position is the sum of g h · k · h.
    assert centre(plant, "stone")[2] == pytest.approx(-G * STEP**2 * n * (n + 1) / 2, rel=1e-9)
    assert velocity(plant, "stone")[2] == pytest.approx(-G * STEP * n, rel=1e-9)


def test_a_thrown_body_turns_about_its_centre_of_mass(tmp_path, engine):
    thrown = Row(box("club", 2.0, 0.4, 0.1, 0.2, centre="0.3 0 0.1"))
    plant = make(tmp_path, engine, {"club": thrown}, "gravity: [0, 0, 0]")
    # About its own z axis, a principal one; it lies on its side.
    turn = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    spin = tuple((rotation(turn) @ (0.0, 0.0, 3.0)).tolist())
    plant.physics.engine.carry(0, ((1.0, 2.0, 3.0), turn), (0.5, 0.0, -1.0), spin)
    before = centre(plant, "club")
    np.testing.assert_allclose(before, (1, 2, 3) + rotation(turn) @ (0.3, 0, 0.1), atol=1e-6)
    advance(plant, 500)
    motion = plant.physics.engine.motion((0, BASE))
    np.testing.assert_allclose(motion.velocity, (0.5, 0.0, -1.0), atol=1e-6)
    np.testing.assert_allclose(motion.spin, spin, atol=1e-6)
    np.testing.assert_allclose(motion.centre, before + np.array((0.25, 0.0, -0.5)), atol=1e-6)
    arm = rotation(motion.frame[1]) @ (0.3, 0.0, 0.1)
    np.testing.assert_allclose(np.add(motion.frame[0], arm), motion.centre, atol=1e-6)


def test_a_pendulum_keeps_its_energy(tmp_path, engine):
    plant = make(tmp_path, engine, {"rod": fixed(ROD)})
    # Semi-implicit Euler keeps H - h/2 · q' · dV/dq up to h², here with V = -T sin q and from rest
    # at 0; so H strays by no more than h/2 · max |q' T cos q|, where q'² = 2 T sin q / I. That is
    # largest where sin² q = 1/3. A tenth more is for h².
    fastest = math.sqrt(2 * ROD_TORQUE * math.sqrt(1 / 3) / ROD_MOMENT)
    bound = 1.1 * STEP / 2 * fastest * ROD_TORQUE * math.sqrt(2 / 3)
    errors = []
    for _ in range(2000):
        q, v = state(advance(plant, 1), "hinge")
        errors.append(ROD_MOMENT * v * v / 2 - ROD_TORQUE * math.sin(q))
    assert np.abs(errors).max() < bound
    assert np.abs(errors).max() > bound / 10
    assert abs(np.mean(errors)) < bound / 5


# --- joints -------------------------------------------------------------------------------


def disc(tmp_path, engine, settings):
    return make(tmp_path, engine, {"disc": fixed(DISC, f"joint_defaults: {{{settings}}}")})


def rod(tmp_path, engine, settings):
    return make(tmp_path, engine, {"rod": fixed(ROD, f"joint_defaults: {{{settings}}}")})


def test_coulomb_friction_stops_a_joint_where_it_should(tmp_path, engine):
    plant = advance(disc(tmp_path, engine, "velocity: 1, friction: 1"), 600)
    # v² I / 2 τ = 0.25 rad, and up to a substep's travel less.
    where, speed = state(plant, "axle")
    assert where == pytest.approx(0.25, abs=1e-3)
    assert abs(speed) < 1e-3
    assert state(advance(plant, 1000), "axle")[0] == pytest.approx(where, abs=1e-3)


@pytest.mark.parametrize(("torque", "expected"), [(0.9, 0.0), (1.5, 1.0)])
def test_coulomb_friction_bears_a_torque_up_to_its_own(tmp_path, engine, torque, expected):
    plant = disc(tmp_path, engine, "friction: 1")
    command(plant, "torque", torque)
    assert state(advance(plant, 500), "axle")[1] == pytest.approx(expected * 0.5, abs=5e-3)


def test_damping_slows_as_an_exponential(tmp_path, engine):
    plant = advance(disc(tmp_path, engine, "velocity: 1, damping: 2"), 500)
    # Euler's steps differ from it by h (d / I)² t / 2 = 0.4 %, in both directions.
    assert state(plant, "axle")[1] == pytest.approx(math.exp(-2 / DISC_MOMENT * 0.5), rel=6e-3)


def test_a_torque_accelerates_no_more_than_the_limit_of_the_motor(tmp_path, engine):
    plant = disc(tmp_path, engine, "effort: 10")
    command(plant, "torque", 100.0)
    expected = 10 / DISC_MOMENT * 0.1
    assert state(advance(plant, 100), "axle")[1] == pytest.approx(expected, rel=1e-6)


def test_a_velocity_drive_gets_there_with_its_torque(tmp_path, engine):
    plant = disc(tmp_path, engine, "mode: velocity, effort: 10")
    command(plant, "velocity", 2.0)
    # 10 N·m take 0.1 s.
    assert state(advance(plant, 50), "axle")[1] == pytest.approx(1.0, rel=0.02)
    assert state(advance(plant, 150), "axle")[1] == pytest.approx(2.0, abs=2e-3)


def test_a_velocity_drive_bears_a_weight_and_reports_its_torque(tmp_path, engine):
    plant = rod(tmp_path, engine, "mode: velocity, effort: 10")
    command(plant, "velocity", 0.0)
    assert state(advance(plant, 1000), "hinge")[0] == pytest.approx(0.0, abs=2e-3)
    assert plant.sense().effort[0] == pytest.approx(-ROD_TORQUE, rel=0.01)


def test_a_drive_that_is_too_weak_gives_what_it_has(tmp_path, engine):
    plant = rod(tmp_path, engine, "mode: velocity, effort: 3")
    command(plant, "velocity", 0.0)
    expected = (ROD_TORQUE - 3) / ROD_MOMENT * 0.05
    assert state(advance(plant, 50), "hinge")[1] == pytest.approx(expected, rel=0.02)


def test_a_position_drive_gets_there_against_a_weight(tmp_path, engine):
    plant = rod(tmp_path, engine, "mode: position, effort: 20, max_velocity: 2")
    command(plant, "position", -0.8)
    speeds = [abs(state(advance(plant, 1), "hinge")[1]) for _ in range(2000)]
    assert state(plant, "hinge")[0] == pytest.approx(-0.8, abs=2e-3)
    assert max(speeds) < 2.0 * 1.05
    assert plant.sense().effort[0] == pytest.approx(-ROD_TORQUE * math.cos(0.8), rel=0.02)


def test_stops_hold_a_falling_rod(tmp_path, engine):
    plant = rod(tmp_path, engine, "lower: -0.1, upper: 0.5")
    places = np.array([state(advance(plant, 1), "hinge")[0] for _ in range(3000)])
    # It arrives at 3.8 rad/s, and may need five substeps.
    fastest = math.sqrt(2 * ROD_TORQUE * math.sin(0.5) / ROD_MOMENT)
    assert places.max() < 0.5 + 5 * fastest * STEP
    assert places[-1] == pytest.approx(0.5, abs=5e-3)


def test_stops_of_a_model_hold_a_slide(tmp_path, engine):
    limit = 'effort="100" velocity="10" lower="-0.2" upper="0.1"'
    slide = link("slide", 1.0, (0.01,) * 3), joint("rail", "prismatic", "slide", "0 0 1", limit)
    plant = advance(make(tmp_path, engine, {"slide": fixed(robot(ROOT, *slide))}), 2000)
    assert state(plant, "rail")[0] == pytest.approx(-0.2, abs=1e-3)


def test_a_joint_with_mimic_follows(tmp_path, engine):
    mimic = '<mimic joint="axle" multiplier="-2" offset="0.1"/>'
    urdf = robot(
        ROOT,
        link("disc", 1.0, (0.5,) * 3),
        joint("axle", "revolute", "disc", "0 0 1", 'lower="-3" upper="3" effort="50" velocity="3"'),
        link("other", 1.0, (0.01,) * 3),
        joint(
            "follower", "revolute", "other", "0 0 1", 'lower="-7" upper="7" effort="50" velocity="9"',
            more=mimic,
        ),
    )  # fmt: skip
    plant = make(tmp_path, engine, {"pair": fixed(urdf, "joint_defaults: {mode: velocity}")})
    driver = plant.commander("command", ["axle"])
    driver.apply(JointCommand(mode="velocity", values=[1.0]))
    errors = []
    for _ in range(500):
        advance(plant, 1)
        errors.append(state(plant, "follower")[0] - (0.1 - 2 * state(plant, "axle")[0]))
    assert state(plant, "axle")[0] == pytest.approx(0.5, abs=0.02)
    assert np.abs(errors).max() < 0.02
    assert abs(errors[-1]) < 2e-3


# --- contacts -----------------------------------------------------------------------------

FLAT = (0.2, 0.2, 0.05)


def on_slope(tmp_path, engine, tangent):
    """Return a box of friction 0.5 on a slope of friction 1, and the direction down."""
    ground, down, thing = slope(math.atan(tangent), 0.5, FLAT[2] / 2)
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


@pytest.mark.parametrize("share", [2 / 5, 1 / 2])
def test_a_ball_rolls_down_a_slope_without_slipping(tmp_path, engine, share):
    """0.4: a solid ball, 5/7 g sin; 0.5: the moment of a disc, 2/3 g sin."""
    angle, radius = math.radians(20), 0.1
    ground, down, thing = slope(angle, 1.0, radius)
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
    plant.physics.engine.carry(0, frame, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
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
    near = plant.physics.engine.closest((0, BASE), 1, 0.1)
    assert near
    nearest = min(near, key=lambda contact: contact.distance)
    assert nearest.distance == pytest.approx(0.05, abs=1e-4)
    assert nearest.normal == pytest.approx((-1, 0, 0), abs=1e-3)
    assert (nearest.one, nearest.other) == ((0, BASE), (1, BASE))
    assert (nearest.on_one[0], nearest.on_other[0]) == pytest.approx((0.1, 0.15), abs=1e-4)
    assert plant.physics.engine.closest((0, BASE), 1, 0.04) == []
    assert plant.physics.engine.neighbours((0, BASE), 0.1) == [(1, BASE)]
    low, high = plant.physics.engine.box((1, BASE))
    assert (*low, *high) == pytest.approx((0.15, -0.1, -0.1, 0.35, 0.1, 0.1), abs=0.025)


# --- sensors and calls --------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["fixed", "revolute"])
def test_a_force_torque_sensor_bears_the_weight_beyond_it(tmp_path, engine, kind):
    """Its child lies on its side, and has its mass elsewhere."""
    origin = f'xyz="0 0 0.2" rpy="{math.pi / 2} 0 0"'
    limit = 'lower="0" upper="0" effort="1e3" velocity="10"'
    urdf = robot(
        ROOT,
        link("tool", 2.0, (0.02, 0.03, 0.04), centre="0.3 0 0.1"),
        joint("mount", kind, "tool", "0 1 0", limit, origin=origin),
    )
    held = "joint_defaults: {mode: position}"
    plant = make(tmp_path, engine, {"arm": fixed(urdf, held)}, "wrenches: {ft: {joint: mount}}")
    sensor = sensed(plant, "Wrench/1")
    reading = sensor.sense(advance(plant, 200).t_ns)
    # Down is -y in the frame of the tool.
    weight = np.array((0.0, -2 * G, 0.0))
    np.testing.assert_allclose(reading.force, weight, atol=0.02)
    np.testing.assert_allclose(reading.torque, np.cross((0.3, 0, 0.1), weight), atol=0.02)


def test_an_imu_at_rest_reads_plus_g(tmp_path, engine):
    standing = Row(box("crate", 1.0, 0.1, 0.1, 0.1), "position: [0, 0, 0.05]")
    bodies = {"ground": fixed(FLOOR), "crate": standing}
    plant = make(tmp_path, engine, bodies, "imus: {imu: {link: crate}}", step_ns=10 * MS)
    sensor = sensed(plant, "Imu/1")
    for _ in range(100):
        reading = sensor.sense(advance(plant, 1).t_ns)
    assert reading.linear_acceleration == pytest.approx((0, 0, G), abs=0.02)
    assert reading.angular_velocity == pytest.approx((0, 0, 0), abs=1e-3)


def test_a_lidar_measures_a_wall_exactly(tmp_path, engine):
    bodies = {
        "post": fixed(box("post", 1.0, 0.02, 0.02, 0.02)),
        "wall": fixed(box("wall", 1.0, 0.2, 8, 8), "position: [2.1, 0, 0]"),
    }
    lidar = "lidars: {lidar: {link: post, rays: 9, angle_min: -1, angle_max: 1, range_max: 3}}"
    scan = sensed(make(tmp_path, engine, bodies, lidar), "LaserScan/1").sense(0)
    expected = 2.0 / np.cos(scan.angle_min + scan.angle_increment * np.arange(9))
    np.testing.assert_allclose(scan.ranges, np.where(expected < 3, expected, np.inf), atol=1e-6)


def test_a_body_that_is_moved_is_there_and_at_rest(tmp_path, engine):
    falling = Row(box("crate", 1.0, 0.1, 0.1, 0.1, centre="0.02 0 0.03"), "position: [0, 0, 3]")
    plant = advance(make(tmp_path, engine, {"ground": fixed(FLOOR), "crate": falling}), 300)
    plant.calls.move_body("crate", 1.0, 2.0, 3.0, math.pi / 2)
    (place, turn), *_ = motion = plant.physics.engine.motion((1, BASE))
    assert place == pytest.approx((1, 2, 3), abs=1e-6)
    assert np.abs(turn) == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)
    assert (*motion.velocity, *motion.spin) == (0.0,) * 6
    before = centre(plant, "crate")[2]
    n = 100
    advance(plant, n)
    fallen = before - centre(plant, "crate")[2]
    assert fallen == pytest.approx(G * STEP**2 * n * (n + 1) / 2, rel=1e-6)


def test_a_state_that_is_saved_goes_on_to_the_bit(tmp_path, engine):
    bodies = {"ground": fixed(FLOOR)} | {
        name: Row(box(name, 1.0, 0.1, 0.1, 0.1), f"position: [{x}, 0, {z}]")
        for name, x, z in (("low", 0.0, 0.05), ("high", 0.03, 0.3))
    }
    first = advance(make(tmp_path, engine, bodies), 250)
    saved = first.physics.engine.save()
    if saved is None:
        pytest.skip(f"{engine} saves no state")
    other = make(tmp_path, engine, bodies)
    other.physics.engine.restore(saved)
    ends = [
        [plant.physics.engine.motion((body, BASE)) for body in (1, 2)]
        for plant in (advance(first, 200), advance(other, 200))
    ]
    assert ends[0] == ends[1]
