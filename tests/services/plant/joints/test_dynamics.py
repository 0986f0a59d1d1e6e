import numpy as np
import pinocchio
import pytest
from support.services.plant import MS, TWO_LINK, body, digest, drive, make_plant, swing
from support.tools import needs_pybullet

from stepbus_plant import SimulatedPlant
from stepbus_plant.engine import PhysicsError
from stepbus_schemas import JointCommand


def free_wheel(tmp_path, settings="{}", world=""):
    return make_plant(tmp_path, body("w", "free_wheel", settings), world=world, step_ns=MS)


def idle(plant: SimulatedPlant, steps: int) -> SimulatedPlant:
    for _ in range(steps):
        plant.advance()
    return plant


def test_the_dynamics_agree_with_pinocchio(tmp_path):
    model = pinocchio.buildModelFromXML(TWO_LINK.read_text(encoding="utf-8"))
    data, rng, worst = model.createData(), np.random.default_rng(1), 0.0
    for _ in range(20):
        q, v = rng.uniform(-2, 2, 2), rng.uniform(-2, 2, 2)
        tau = pinocchio.rnea(model, data, q, v, rng.uniform(-5, 5, 2))
        start = "{{joint1: {{position: {}, velocity: {}}}, joint2: {{position: {}, velocity: {}}}}}"
        arm = body("arm", "two_link", joints=start.format(q[0], v[0], q[1], v[1]))
        after = drive(
            make_plant(tmp_path, arm, step_ns=1000),
            JointCommand(mode="torque", values=list(tau)),
            1,
        )
        a = (after[0, 1] - v) / 1e-6
        worst = max(worst, np.abs(pinocchio.rnea(model, data, q, v, a) - tau).max())
    assert worst < 1e-6


def test_substeps_refine_the_physics_and_not_the_communication(tmp_path):
    runs = [swing(make_plant(tmp_path, world=f"substeps: {n}"), 200) for n in (1, 10, 100)]
    coarse, medium, fine = (run[-1, 0] for run in runs)
    assert [len(run) for run in runs] == [200, 200, 200]
    assert np.abs(medium - fine).max() < np.abs(coarse - fine).max() / 5


def test_substeps_and_physics_step_are_two_ways_to_say_the_same(tmp_path):
    runs = [swing(make_plant(tmp_path, world=w), 50) for w in ("substeps: 5", "physics_step: 1ms")]
    assert digest(runs[0]) == digest(runs[1])


def test_without_damping_a_wheel_turns_for_ever(tmp_path):
    plant = idle(free_wheel(tmp_path, "{velocity: 1}"), 2000)
    assert plant.sense().velocity[0] == pytest.approx(1.0, abs=1e-12)


def test_friction_does_not_show_in_the_effort_of_the_motor(tmp_path):
    plant = idle(free_wheel(tmp_path, "{velocity: 1, friction: 1}"), 10)
    assert plant.sense().effort == [0.0]


def test_stops_of_the_world_can_be_wider_than_the_urdfs(tmp_path):
    plant = make_plant(tmp_path, body("w", "wheel", "{velocity: 1, upper: 5}"), step_ns=MS)
    assert idle(plant, 2000).sense().position[0] == pytest.approx(2.0)


def test_a_joint_starts_at_the_place_nearest_to_zero_within_its_stops(tmp_path):
    plant = make_plant(tmp_path, body("w", "wheel", "{lower: 0.4, upper: 0.9}"))
    assert plant.sense().position == [0.4]


def test_gravity_is_the_worlds(tmp_path):
    up = idle(make_plant(tmp_path, world="gravity: [0, 0, 9.81]"), 20).sense().position[0]
    down = idle(make_plant(tmp_path), 20).sense().position[0]
    assert up == pytest.approx(-down)
    assert down > 0.01


def test_a_rotated_base_carries_its_joints_along(tmp_path):
    arm = "  arm: {urdf: two_link.urdf, fixed_base: true, orientation_rpy: [1.5707963267948966, 0, 0]}\n"
    plant = idle(make_plant(tmp_path, arm), 20)
    assert plant.sense().position == pytest.approx([0.0, 0.0], abs=1e-6)


def test_nothing_cuts_a_velocity_behind_the_users_back(tmp_path):
    plant = free_wheel(tmp_path, "{effort: 1.0e+4}")
    states = drive(plant, JointCommand(mode="torque", values=[1e4]), 100)
    assert states[-1, 1, 0] == pytest.approx(1e4 / 0.5 * 0.1)


@needs_pybullet
def test_a_diverging_simulation_is_reported_with_the_joint(tmp_path):
    settings = "{velocity: 1, damping: 1.0e+5}"
    plant = idle(free_wheel(tmp_path, settings, world="engine: pybullet"), 500)
    with pytest.raises(PhysicsError, match=r"axle\); use a shorter physics_step"):
        plant.sense()


def test_closing_a_plant_twice_leaves_the_next_one_alone(tmp_path):
    first = make_plant(tmp_path)
    first.close()
    second = make_plant(tmp_path)
    first.close()
    assert idle(second, 1).sense().position[0] > 0


def test_the_params_physics_step_goes_over_the_worlds(tmp_path):
    fast = swing(make_plant(tmp_path, world="physics_step: 1ms", physics_step="5ms"), 20)
    assert np.array_equal(fast, swing(make_plant(tmp_path, world="physics_step: 5ms"), 20))
    assert not np.array_equal(fast, swing(make_plant(tmp_path, world="physics_step: 1ms"), 20))


def test_two_plants_in_one_process_give_the_same_bits(tmp_path):
    first, second = (swing(make_plant(tmp_path), 300) for _ in range(2))
    assert digest(first) == digest(second)
