"""Each engine beside the closed form. Tolerances were written before any engine was measured."""

import math

import numpy as np
import pytest
from support.services.mechanics import (
    DISC,
    DISC_MOMENT,
    MS,
    ROD,
    ROD_MOMENT,
    ROD_TORQUE,
    ROOT,
    STEP,
    G,
    Row,
    advance,
    box,
    centre,
    command,
    fixed,
    joint,
    link,
    make,
    robot,
    state,
    velocity,
)

from stepbus_plant.engine import BASE
from stepbus_plant.geometry import rotation
from stepbus_schemas import JointCommand

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
    plant.physics.engine.put(0, ((1.0, 2.0, 3.0), turn), (0.5, 0.0, -1.0), spin)
    before = centre(plant, "club")
    np.testing.assert_allclose(before, (1, 2, 3) + rotation(turn) @ (0.3, 0, 0.1), atol=1e-6)
    advance(plant, 500)
    motion = plant.physics.engine.motion((0, BASE))
    # MuJoCo integrates the frame of a link, which circles at 0.9 m/s: v grows by ω² h t / 2.
    off = 1e-6 if engine == "pybullet" else 3.0**2 * STEP * 0.5 / 2 * 0.9
    np.testing.assert_allclose(motion.velocity, (0.5, 0.0, -1.0), atol=off)
    np.testing.assert_allclose(motion.spin, spin, atol=1e-6)
    np.testing.assert_allclose(motion.centre, before + np.array((0.25, 0.0, -0.5)), atol=off)
    arm = rotation(motion.frame[1]) @ (0.3, 0.0, 0.1)
    np.testing.assert_allclose(np.add(motion.frame[0], arm), motion.centre, atol=1e-6)


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


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_comes_back_however_far_a_substep_takes_it_past_its_stop(tmp_path, engine, kind):
    limit = 'effort="100" velocity="100" lower="-1" upper="1"'
    fast = link("fast", 1.0, (0.5,) * 3), joint("free", kind, "fast", "0 0 1", limit)
    plant = make(
        tmp_path, engine, {"fast": fixed(robot(ROOT, *fast))}, "gravity: [0, 0, 0]", 5 * MS
    )
    # One substep takes it 4 cm (0.04 rad) past its stop. Unlike the other tolerances here, these
    # were written after PyBullet was measured.
    plant.physics.engine.put_joint(0, 0, 0.99, 10.0)
    places = np.array([state(advance(plant, 1), "free")[0] for _ in range(400)])
    assert places.max() < 1.0 + 2 * 10.0 * 0.005
    # MuJoCo's stop throws it back, to the other one, of which the same is true.
    speed = 0.0 if engine == "pybullet" else abs(places[21] - places[20]) / 0.005
    assert np.abs(places[20:]).max() < 1.0 + max(1e-3, speed * 2 * 0.01 / math.e)


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


def test_a_joint_whose_stops_are_one_place_is_locked(tmp_path, engine):
    plant = rod(tmp_path, engine, "lower: 0.4, upper: 0.4")
    places = [state(advance(plant, 1), "hinge")[0] for _ in range(500)]
    assert places == pytest.approx([0.4] * 500, abs=5e-3)


def test_a_brake_holds_a_torque_driven_joint(tmp_path, engine):
    plant = rod(tmp_path, engine, "effort: 20")
    command(plant, "brake", 1.0)
    assert state(advance(plant, 1000), "hinge")[0] == pytest.approx(0.0, abs=2e-3)
    command(plant, "torque", 0.0)
    expected = ROD_TORQUE / ROD_MOMENT * 0.05
    assert state(advance(plant, 50), "hinge")[1] == pytest.approx(expected, rel=0.01)


def test_a_torque_by_way_of_a_velocity_motor_is_the_same_torque(tmp_path, engine):
    plant = disc(tmp_path, engine, "actuation: velocity_force, effort: 10")
    command(plant, "torque", 3.0)
    assert state(advance(plant, 100), "axle")[1] == pytest.approx(3 / DISC_MOMENT * 0.1, rel=1e-3)
    assert plant.sense().effort == pytest.approx([3.0], rel=1e-3)


def test_the_motion_of_a_link_is_that_of_its_centre_of_mass(tmp_path, engine):
    plant = make(tmp_path, engine, {"rod": fixed(ROD, "position: [0, 0, 2]")})
    plant.physics.teleport(plant.physics.joints["hinge"], 0.7, 2.0)
    motion = plant.physics.engine.motion(plant.physics.links["rod"])
    spin = np.array((0.0, 2.0, 0.0))
    arm = 0.5 * np.array((math.cos(0.7), 0.0, -math.sin(0.7)))
    np.testing.assert_allclose(motion.frame[0], (0, 0, 2), atol=1e-6)
    np.testing.assert_allclose(motion.centre, np.add(arm, (0, 0, 2)), atol=1e-6)
    np.testing.assert_allclose(motion.spin, spin, atol=1e-6)
    np.testing.assert_allclose(motion.velocity, np.cross(spin, arm), atol=1e-6)


def test_a_double_pendulum_keeps_its_energy(tmp_path, engine):
    """As the rod: semi-implicit Euler strays in proportion to the step, and does not drift."""
    urdf = ROD.replace("</robot>", "") + "".join(
        (
            link("other", 1.0, (1e-4, 1 / 12, 1 / 12), centre="0.5 0 0"),
            joint("knee", "continuous", "other", parent="rod", origin='xyz="1 0 0"'),
            "</robot>",
        )
    )
    plant = make(tmp_path, engine, {"arm": fixed(urdf)}, step_ns=MS // 4)
    engine_, links = plant.physics.engine, [plant.physics.links[n] for n in ("rod", "other")]
    energies = []
    for _ in range(4000):
        energy = 0.0
        for motion in map(engine_.motion, links):
            energy += 0.5 * np.dot(motion.velocity, motion.velocity) + G * motion.centre[2]
            energy += 0.5 * np.dot(motion.spin, motion.spin) / 12
        energies.append(energy)
        advance(plant, 1)
    # 1 % of what it falls by: 14.7 J at most.
    assert np.abs(energies).max() < 0.15
    assert np.ptp(energies) > 0.0


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
